"""The sentence that opens the report: the best controller, its margin and the reason."""

from typing import Any

import numpy as np
import pytest
from benches.logs import failure, fill_log, results, rows
from numpy.typing import ArrayLike

from omni_mj.results.summary_sentence import summary_sentence

FRAMES = 30


def summary(
    errors_cm: dict[str, ArrayLike], axis: int = 0, failed: str = "", **head: Any
) -> dict[str, Any]:
    """Summarize controllers whose error, one per seed, is the same in all frames.

    The reference moves along x, so that axis 0 is along the path and axis 1 across it.
    """
    values = np.array([np.atleast_1d(error) for error in errors_cm.values()]) / 100
    all_rows = rows(tuple(errors_cm), range(values.shape[1]))
    reference, pose = np.zeros((2, FRAMES, len(all_rows), 3))
    reference[:, :, 0] = 0.01 * np.arange(FRAMES)[:, None]
    pose[:] = reference
    pose[:, :, axis] += values.ravel()
    log = fill_log(all_rows, FRAMES, ref=reference, pose=pose)
    failures = [failure(log, int(log.rows_of(failed)[-1]))] if failed else []
    entry = {"results": results(log, failures)}
    return {"privileged": [], "scenarios": {"rect": entry}} | head


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (
            summary({"flc": 2.0}),
            "flc follows the reference with a mean position error of 2.00 cm, mainly along the"
            " path.",
        ),
        (
            summary({"flc": 2.0, "mpc": 0.5}),
            "mpc is best: its mean position error of 0.50 cm is 75 % below that of flc, mainly by"
            " better timing: along-track error 0.50 cm instead of 2.00 cm.",
        ),
        (
            summary({"flc": [2.0, 2.2, 2.1], "mpc": [1.0, 1.1, 1.2]}, axis=1),
            "mpc is best: its mean position error of 1.10 cm is 48 % below that of flc, mainly by"
            " keeping closer to the path: cross-track error 1.10 cm instead of 2.10 cm.",
        ),
        (
            summary({"flc": [2.0, 3.0, 1.0], "mpc": [1.0, 1.0, 3.5]}),
            "mpc (1.83 cm) and flc (2.00 cm) do not differ significantly in mean position error"
            " over 3 seeds.",
        ),
        (
            summary({"flc": 2.0, "p": 2.0}),
            "flc and p have the same mean position error, 2.00 cm.",
        ),
        (
            summary({"flc": 2.001, "p": 2.0}),
            "p and flc have almost the same mean position error, 2.00 cm.",
        ),
        (
            summary({"flc": [2.001, 2.002], "p": [2.0, 2.001]}),
            "p and flc have almost the same mean position error, 2.00 cm.",
        ),
        (
            summary({"flc": [2.0, 2.0], "mpc": [0.5, 0.5]}, failed="mpc"),
            "flc follows the reference with a mean position error of 2.00 cm, mainly along the"
            " path; mpc failed in 1 of 2 seeds.",
        ),
        (
            summary({"flc": 2.0}, failed="flc"),
            "No controller finished all seeds; flc failed in 1 of 1 seed.",
        ),
        (
            summary({"flc": 2.0, "oracle": 0.1}, privileged=["oracle"]),
            "flc follows the reference with a mean position error of 2.00 cm, mainly along the"
            " path.",
        ),
        ({"privileged": [], "scenarios": {"rect": {"results": {}}}}, ""),
    ],
)
def test_the_sentence_names_the_best_controller_the_margin_and_the_reason(
    content: Any, sentence: str
) -> None:
    assert summary_sentence(content) == sentence


def test_the_sentence_counts_wins_over_several_scenarios() -> None:
    scenarios = {
        name: summary({"flc": flc, "mpc": 1.0})["scenarios"]["rect"]
        for name, flc in {"rect": 2.0, "circle": 0.5, "eight": 3.0}.items()
    }
    sentence = (
        "mpc has the smallest maximum position error in 2 of 3; "
        "mpc has the smallest mean position error in 2 of 3 scenarios (averages over the seeds)."
    )
    assert summary_sentence({"privileged": [], "scenarios": scenarios}) == sentence

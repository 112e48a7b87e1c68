"""Summary, tables and files of a result agree with each other and with the frames."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import scipy.stats
from benches.logs import failure, fill_log, outcome, paper_tables, results_table, rows

import omni_mj as om
from omni_mj.results.summary_sentence import summary_sentence

SEEDS = (3, 4, 5)
BACKEND = "jax" if importlib.util.find_spec("jax") else "numpy"  # jax is faster, but an extra
RECT = om.load_scenario("rect", plant="planar", physics={"backend": BACKEND})


@pytest.fixture(scope="module")
def result() -> om.Result:
    """Return a result of the default scenario with three seeds."""
    return om.run(RECT, seeds=SEEDS)


@pytest.fixture(scope="module")
def recorded(result: om.Result) -> dict[tuple[str, int], dict[str, np.ndarray]]:
    """Return the columns of the frames of each controller and seed."""
    lines: dict[tuple[str, int], dict[str, list[Any]]] = {}
    columns = result.frames().to_pydict()
    for i, key in enumerate(zip(columns.pop("controller"), columns.pop("seed"), strict=True)):
        for name, values in columns.items():
            lines.setdefault(key, {}).setdefault(name, []).append(values[i])
    return {
        key: {name: np.array(values) for name, values in changes.items()}
        for key, changes in lines.items()
    }


def of_a_row(row: dict[str, np.ndarray]) -> dict[str, float]:
    """Compute the statistics from their definitions. All of these runs settle."""
    ex, ey = abs(row["x_m"] - row["ref_x_m"]), abs(row["y_m"] - row["ref_y_m"])
    path = row["ref_x_m"] + 1j * row["ref_y_m"]
    turn = np.exp(1j * (row["heading_rad"] - row["ref_heading_rad"]))
    errors = {"x": ex, "y": ey, "position": (ex**2 + ey**2) ** 0.5}
    errors["heading"] = abs(np.angle(turn))
    ax, ay = (np.diff(row[f"command_v{axis}_m_s"], prepend=0) * 60 for axis in "xy")
    at_rest = (row["ref_x_m"] == row["ref_x_m"][-1]) & (row["ref_y_m"] == row["ref_y_m"][-1])
    rest = int(np.flatnonzero(~at_rest)[-1]) + 1  # the rectangle also starts where it ends
    settled = [k for k in range(rest, len(ex)) if (errors["position"][k:] < 0.01).all()]
    controller_result = {
        f"error_{'rad' if name == 'heading' else 'm'}.{name}.{key}": float(law(error))
        for name, error in errors.items()
        for key, law in {"max": max, "p99": lambda e: np.quantile(e, 0.99), "mean": np.mean,
                         "rms": lambda e: np.mean(e**2) ** 0.5}.items()
    }  # fmt: skip
    needed = np.diff(np.diff(path, prepend=path[0], append=path[-1])) * 60**2
    controller_result["effort_m_s2"] = float(np.mean(ax**2 + ay**2)) ** 0.5
    controller_result["excess_effort_m_s2"] = (
        float(np.mean(ax**2 + ay**2) - np.mean(abs(needed) ** 2)) ** 0.5
    )
    controller_result["settle_s"] = (settled[0] - rest) / 60
    return controller_result


def test_every_number_of_the_summary_follows_from_the_frames(
    result: om.Result, recorded: Any
) -> None:
    """Tolerance 1e-12 for the order of sums; scipy gives the intervals."""
    results = result.summary()["scenarios"]["rect"]["results"]
    assert list(results) == ["flc", "comp-flc"]
    for controller, controller_result in results.items():
        row_metrics = [of_a_row(recorded[controller, seed]) for seed in SEEDS]
        for key in row_metrics[0]:
            spread = controller_result
            for key_part in key.split("."):
                spread = spread[key_part]
            values = [metrics_of_seed[key] for metrics_of_seed in row_metrics]
            half = scipy.stats.t.ppf(0.975, 2) * np.std(values, ddof=1) / 3**0.5
            assert spread["per_seed"] == pytest.approx(values, rel=1e-12, abs=1e-12), key
            expected = [np.median(values), min(values), max(values), sum(values) / 3, half]
            assert list(spread.values())[1:] == pytest.approx(expected, rel=1e-9, abs=1e-12), key


def test_the_compensator_helps_as_in_the_paper_if_not_as_much(result: om.Result) -> None:
    """It lowers both errors in both axes, and maxima are of the size of the paper's (table 3).

    The paper's robot loses by its gain alone. One whose wheels creep also lags by some frames, more
    the faster it is, of which the compensator knows nothing: of the reductions of the maximum, 35
    and 49 %, these three seeds keep 33 and 25 %, and of the mean 69 and 50 %. Asked for is about
    half of that. Maxima without compensation are 1.1 of the paper's. Compensated maxima are 1.1
    forward, and 1.6 sideways, where creep lags twice as much.
    """
    entry = result.summary()["scenarios"]["rect"]
    for axis in ("x", "y"):
        for key, min_reduction in (("max", 0.1), ("mean", 0.3)):
            flc, compensated = (
                entry["results"][name]["error_m"][axis][key]["median"]
                for name in ("flc", "comp-flc")
            )
            assert 1 - compensated / flc > min_reduction, (axis, key)
        for controller, controller_result in entry["results"].items():
            ratio = (
                controller_result["error_m"][axis]["max"]["median"]
                / entry["paper"][controller][axis]["max"]
            )
            limit = 1.8 if (axis, controller) == ("y", "comp-flc") else 1.3
            assert 1 / limit < ratio < limit, (axis, controller)
    assert entry["paper"]["comp-flc"]["x"]["max"] == 0.02124


def test_the_papers_errors_appear_for_its_experiment_only() -> None:
    """Controllers and plants may differ; reference, dead time, carpet and alpha may not."""
    for changes in (
        {},
        {"plant": "kinematic"},
        {"controllers": ("lqr",), "control": {"assumed_lag_s": 0.1}, "seeds": 7},
    ):
        assert (
            paper_tables.find_paper_table(om.load_scenario("rect", **changes))
            is paper_tables.TABLES[3]
        )
        assert (
            paper_tables.find_paper_table(om.load_scenario("rect-noise", **changes))
            is paper_tables.TABLES[4]
        )
    for section, values, plant in (
        ("reference", {"laps": 2}, "mujoco"),
        ("radio", {"delay_frames": 7}, "kinematic"),
        ("carpet", {"friction": 0.4}, "mujoco"),
        ("kinematic", {"alpha_low": 0.8}, "kinematic"),
    ):
        assert (
            paper_tables.find_paper_table(
                om.load_scenario("rect", plant=plant, **{section: values})
            )
            is None
        )
    assert (
        paper_tables.find_paper_table(
            om.load_scenario("rect", plant="kinematic", carpet={"friction": 0.4})
        )
        is paper_tables.TABLES[3]
    )
    assert paper_tables.find_paper_table(om.load_scenario("circle")) is None


def test_files_contain_the_summary_the_frames_and_the_scenario(
    result: om.Result, tmp_path: Path
) -> None:
    """Folders are created, existing files are replaced, and the saved scenario is the one run."""
    folder = tmp_path / "deep" / "down"
    result.save(folder)
    result.save(str(folder))
    names = {"summary.json", "scenario.toml", "trajectory.parquet", "provenance.json", "sources"}
    assert {p.name for p in folder.iterdir()} == names
    text = (folder / "summary.json").read_text()
    assert json.loads(text, parse_constant=pytest.fail) == json.loads(json.dumps(result.summary()))
    saved_names, frames = pq.read_table(folder / "trajectory.parquet"), result.frames()
    assert saved_names.schema.equals(frames.schema)
    for name in frames.column_names:
        np.testing.assert_array_equal(
            saved_names[name].to_pylist(), frames[name].to_pylist(), err_msg=name
        )
    again = om.load_scenario(folder / "scenario.toml")
    assert (again.seed_list, again.controllers) == (list(SEEDS), ("flc", "comp-flc"))
    assert again.settings == result["rect"].scenario.settings


def test_rows_have_names_differing_settings_failures_and_metrics() -> None:
    """One of two settings fails: table of rows, summary and text agree."""
    chosen = om.load_scenario("rect", plant="kinematic")
    slow = chosen.settings.replace(radio={"delay_frames": 9})
    log = fill_log(
        [*rows(("a", "b"), (0, 1), chosen.settings), *rows(("a", "b"), (2,), slow)],
        30,
        [30, 30, 30, 8, 30, 30],
    )
    failures = [failure(log, 3)]
    result = om.Result([outcome(chosen, log, failures)], ("a", "b"), (), (0, 1, 2))
    entry = result["rect"].entry
    lines = result.rows().to_pylist()
    assert [(r["controller"], r["seed"], r["radio.delay_frames"]) for r in lines] == [
        ("a", 0, 6), ("a", 1, 6), ("b", 0, 6), ("b", 1, 6), ("a", 2, 9), ("b", 2, 9)
    ]  # fmt: skip
    assert {name for name in lines[0] if "." in name} == {"radio.delay_frames"}
    assert [(r["failed_at_s"], r["cause"]) for r in lines if r["cause"]] == [
        (8 / 60, "toppled over")
    ]
    assert [r["position_max_m"] for r in lines] == [0, 0, 0, np.inf, 0, 0]
    assert entry["failures"] == [
        {"controller": "b", "seed": 1, "slot": 0, "time_s": 8 / 60, "cause": "toppled over"}
    ]  # fmt: skip
    assert [controller_result["n_failed"] for controller_result in entry["results"].values()] == [
        0,
        1,
    ]
    assert "b (failed 1 of 3)" in result.table()
    assert len(result.frames()) == 5 * 30 + 8
    assert results_table(result.summary()).rows[1][3] == "0.00/0.00", (
        "the median of three seeds stands one that failed"
    )


class Still(om.Controller):
    speed = 0.0  # m/s

    def command(self, frame: int, observation: om.Observation) -> np.ndarray:
        return np.full((len(observation.pose), 3), self.speed)


class Rounding(Still):
    speed = 1e-15


class Drifting(Still):
    speed = 1e-3


@pytest.mark.parametrize("baseline", [Still, Rounding])
def test_no_percentage_of_an_error_that_is_zero_or_rounding(baseline: type[Still]) -> None:
    """A robot rests on its reference; one drifts away, and others by rounding only."""
    reference = {"waypoints": [[0, 0], [0, 0]], "settle_s": 1.0}
    scenario = om.load_scenario("rect", plant="kinematic", reference=reference)
    others = {Still, Rounding} - {baseline}
    result = om.run(scenario, [baseline, *others, Drifting], subject="Drifting")
    assert "%" not in summary_sentence(result.summary())
    lines = result.table().splitlines()
    assert sum("baseline" in line for line in lines) == 1
    assert not [line for line in lines if "+" in line or "-" in line or "inf" in line]
    against = result.summary()["scenarios"]["rect"]["verdict"]["errors"]["mean"]["against"]
    assert {comparison["ratio"] for comparison in against.values()} == {None}

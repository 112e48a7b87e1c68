"""What a setting does to an error: laws of which the parts are known, and robots whose trajectories are kept."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import omni_mj as om
from omni_mj.cli.sweep import command
from omni_mj.scenarios.distributions import Distribution
from omni_mj.studies import sweep
from omni_mj.studies.sweep import kept
from omni_mj.studies.sweep.sensitivity import Design, indices, plan

SHORT = {"waypoints": [[0, 0], [0.2, 0.1]], "settle_s": 0.1}


def test_parts_of_the_variance_of_a_sum_are_those_of_its_terms() -> None:
    """y = 3 a + b of uniform a and b, and c in nothing: the parts are 9 / 10, 1 / 10 and none; by themselves as in all.

    With 512 samples the indices of so smooth a function are known to 2 %.
    """
    design, names = Design("sobol", 512), ["a", "b", "c"]
    cube = design.cube(names)
    assert cube.shape == (512 * 5, 3)
    first, second, none = design.analysed(names, 3 * cube[:, 0] + cube[:, 1])
    for found, part in ((first, 0.9), (second, 0.1), (none, 0.0)):
        assert found["S1"] == pytest.approx(part, abs=0.02)
        assert found["ST"] == pytest.approx(part, abs=0.02)


def test_effects_of_a_product_differ_from_place_to_place() -> None:
    """y = 2 a b: of a the mean effect is 2 mean(b), spread as 2 b; y = a: 1 everywhere. Levels are 0, 1/3, 2/3, 1."""
    design, names = Design("morris", 500), ["a", "b"]
    cube = design.cube(names)
    a, _ = design.analysed(names, 2 * cube[:, 0] * cube[:, 1])
    assert a["mu_star"] == pytest.approx(1.0, abs=0.1)
    assert a["sigma"] == pytest.approx(2 * np.std([0, 1 / 3, 2 / 3, 1]), rel=0.1)
    plain, nothing = design.analysed(names, cube[:, 0])
    assert (plain["mu_star"], plain["sigma"]) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-9))
    assert nothing["mu_star"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "drawn",
    [
        Distribution("uniform", (0.4, 0.9)),
        Distribution("uniform", (2, 9), whole=True),
        Distribution("normal", (1.0, 0.2)),
        Distribution("normal", (1.0, 0.5, 0.8, 2.0)),
        Distribution("choice", (0.3, 0.5, 0.8)),
    ],
)
def test_quantiles_are_those_of_the_draws(drawn: Distribution) -> None:
    """Of evenly spread shares and of random draws: one law, by the test of Kolmogorov and Smirnov."""
    random = np.random.default_rng(0)
    draws = [drawn.draw(random) for _ in range(2000)]
    quantiles = [drawn.quantile(share) for share in (np.arange(2000) + 0.5) / 2000]
    assert stats.ks_2samp(draws, quantiles).pvalue > 0.01


def test_a_setting_that_no_part_of_the_plant_knows_is_found_to_do_nothing(tmp_path: Path) -> None:
    """The carpet of the kinematic plant, beside the dead time: all of the variance is the latter's. By the command."""
    command.main(
        [
            "--scenario", "rect", "--plant", "kinematic", "--controller", "p", "--quiet", "--out", str(tmp_path / "s"),
            "--set", "reference.waypoints=[[0, 0], [0.2, 0.1]]", "--set", "reference.settle_s=0.1",
            "--set", "radio.delay_frames={uniform = [0, 8]}", "--set", "carpet.friction={uniform = [0.4, 0.9]}",
            "--sensitivity", "sobol", "--samples", "16",
        ],
        standalone_mode=False,
    )  # fmt: skip
    lines = [line for line in indices(sweep.resume(tmp_path / "s")) if line["of"] == "distance_max_m"]
    parts = {line["setting"]: line for line in lines}
    assert parts["carpet.friction"]["ST"] == 0.0
    assert parts["radio.delay_frames"]["ST"] == pytest.approx(1.0, abs=0.5)  # of 16 samples
    assert "radio.delay_frames" in (tmp_path / "s" / "sensitivity.md").read_text()
    assert (tmp_path / "s" / "sensitivity.png").stat().st_size > 5_000


def test_kept_robots_are_the_worst_the_middle_and_a_sample_and_drive_as_they_did(tmp_path: Path) -> None:
    """Ranked anew here, by hand; each one's folder holds the errors that the sweep has of it, to the bit."""
    scenario = om.scenario("rect", plant="kinematic", reference=SHORT)
    wishes = ["worst:2", "median", "sample:2"]
    found = sweep.sweep(scenario, {"radio.delay_frames": [0, 5]}, ["p"], range(3), out=tmp_path / "s", keep=wishes)
    rows = found.rows().to_pylist()
    ranked = sorted(rows, key=lambda row: -row["distance_max_m"])
    expected = [*ranked[:2], ranked[2], rows[0], rows[-1]]
    chosen = kept.chosen(found, [kept.wish(each) for each in wishes])
    assert [(point, seed) for point, _, seed in chosen.values()] == [(row["point"], row["seed"]) for row in expected]
    for name, row in zip(chosen, expected, strict=True):
        folder = tmp_path / "s" / "kept" / name
        assert (folder / "trajectory.parquet").is_file()
        text = (folder / "scenario.toml").read_text()
        assert f"delay_frames = {row['radio.delay_frames']}\n" in text
        again = om.run(om.scenario(folder / "scenario.toml")).rows().to_pylist()
        assert [each["distance_max_m"] for each in again] == [row["distance_max_m"]]


def test_what_is_not_allowed_is_said_in_a_line() -> None:
    drawn = om.scenario("rect", plant="kinematic", carpet={"friction": {"normal": [0.6, 0.1]}})
    for wrong, words in (
        (lambda: Design("sobols", 64), "one of sobol, morris"),
        (lambda: Design("sobol", 60), "a power of two"),
        (lambda: plan("rect", Design("sobol", 4)), "nothing is drawn"),
        (lambda: plan(drawn, Design("morris", 4)), "have ends"),
        (lambda: kept.wish("best:3"), "cannot read --keep best:3"),
        (lambda: kept.wish("worst:0"), "N up to 1000"),
    ):
        with pytest.raises(om.OmniError, match=words):
            wrong()

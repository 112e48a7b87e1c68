"""Settings that are drawn: by the statistics they say, the same for all controllers, whatever else is drawn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
from scipy import stats

import omni_mj as om
from omni_control.errors import OmniError
from omni_mj.scenarios import distributions
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.simulate.simulation import Simulation

DRAWS = 400
WAY = {"waypoints": [[0, 0], [0.2, 0.1]]}


def made(**sections: object) -> Scenario:
    return om.scenario("rect", plant="kinematic", reference=WAY, **sections)


@pytest.mark.parametrize(
    ("written", "law"),
    [
        ({"uniform": [0.4, 0.9]}, stats.uniform(0.4, 0.5)),
        ({"normal": [0.6, 0.05]}, stats.norm(0.6, 0.05)),
        ({"normal": [0.6, 0.2, 0.3, 0.7]}, stats.truncnorm(-1.5, 0.5, 0.6, 0.2)),
    ],
)
def test_draws_follow_their_law(written: dict[str, list[float]], law: stats.rv_continuous) -> None:
    """By Kolmogorov and Smirnov: with these fixed seeds no chance is involved, with others 1 in 1,000 would fail."""
    chosen = made(carpet={"friction": written})
    drawn = [chosen.settings_of(seed).carpet.friction for seed in range(DRAWS)]
    assert stats.kstest(drawn, law.cdf).pvalue > 1e-3


def test_whole_numbers_and_choices_are_drawn_evenly() -> None:
    """Each of k has DRAWS / k draws, within four deviations of the binomial law."""
    chosen = made(radio={"delay_frames": {"uniform": [2, 6]}}, wheels={"model": {"choice": ["rollers", "two-rollers"]}})
    settings = [chosen.settings_of(seed) for seed in range(DRAWS)]
    for values, known in (
        ([each.radio.delay_frames for each in settings], [2, 3, 4, 5, 6]),
        ([each.wheels.model for each in settings], ["rollers", "two-rollers"]),
    ):
        share = 1 / len(known)
        counts = np.array([values.count(each) for each in known])
        assert counts.sum() == DRAWS
        assert np.abs(counts - DRAWS * share).max() < 4 * np.sqrt(DRAWS * share * (1 - share))


@tried(deadline=None, max_examples=25)
@given(st.integers(0, 2**63 - 1), st.floats(0.05, 2), st.floats(0.05, 2))
def test_what_a_seed_draws_does_not_depend_on_what_else_is_drawn(seed: int, one: float, other: float) -> None:
    friction = {"uniform": sorted([one, other])}
    alone = made(carpet={"friction": friction})
    together = made(carpet={"friction": friction}, battery={"charge": {"uniform": [0.2, 1.0]}})
    assert alone.settings_of(seed).carpet.friction == together.settings_of(seed).carpet.friction
    assert min(one, other) <= alone.settings_of(seed).carpet.friction <= max(one, other)


def test_rows_have_what_their_seeds_draw_and_the_result_says_it() -> None:
    chosen = made(radio={"delay_frames": {"uniform": [0, 9]}})
    result = om.run(chosen, ["p", "flc"], seeds=range(3, 6))
    (outcome,) = result.outcomes
    assert [row.settings for row in outcome.rows] == 2 * [chosen.settings_of(seed) for seed in (3, 4, 5)]
    expected = [chosen.settings_of(seed).radio.delay_frames for seed in (3, 4, 5)]
    assert [each["radio.delay_frames"] for each in outcome.entry["drawn"]] == expected
    assert outcome.entry["settings"]["radio"]["delay_frames"] == {"uniform": [0, 9]}
    # A row alone is the same as among others: each lags by its own dead time.
    alone = om.run(chosen.replace(seed=5), ["flc"])
    column = "x_m"
    rows = result.frames().filter(
        (result.frames()["seed"].to_numpy() == 5) & (result.frames()["controller"].to_numpy() == "flc")
    )
    np.testing.assert_array_equal(rows[column].to_numpy(), alone.frames()[column].to_numpy())


def test_a_reset_with_another_seed_draws_anew() -> None:
    chosen = made(carpet={"friction": {"uniform": [0.4, 0.9]}})
    simulation = Simulation(chosen, ["p"])
    simulation.reset(seed=7)
    assert simulation.rows[0].settings == chosen.settings_of(7)


def test_a_file_says_what_is_drawn_and_repeats_it(tmp_path: pytest.TempPathFactory) -> None:
    chosen = load("rect", ["carpet.friction={normal = [0.6, 0.1, 0.4, 0.8]}", "radio.delay_frames={choice = [3, 6]}"])
    file = tmp_path / "again.toml"
    file.write_text(chosen.to_toml(), encoding="utf-8")
    assert load(str(file)).to_toml() == chosen.to_toml()
    assert load(str(file)).settings_of(4) == chosen.settings_of(4)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"carpet": {"friction": {"uniform": [0.9, 0.4]}}}, "low below high"),
        ({"carpet": {"friction": {"uniform": [0.4, 90.0]}}}, "carpet.friction must be"),
        ({"carpet": {"friction": {"normal": [0.4, 0]}}}, "deviation above 0"),
        ({"carpet": {"friction": {"poisson": [3]}}}, "one of uniform, normal, choice"),
        ({"carpet": {"fricton": {"uniform": [0.4, 0.9]}}}, "carpet.friction"),
        ({"wheels": {"model": {"uniform": [1, 2]}}}, "choice"),
        ({"wheels": {"model": {"choice": ["rollers", "square"]}}}, "wheels.model must be"),
        ({"carpet": {"friction": {"choice": []}}}, "choice = a list"),
    ],
)
def test_what_cannot_be_drawn_is_refused(section: dict[str, dict[str, object]], words: str) -> None:
    with pytest.raises(OmniError, match=words):
        made(**section)


def test_a_draw_that_is_not_allowed_names_its_seed() -> None:
    chosen = made(carpet={"friction": {"normal": [0.1, 5.0]}})
    with pytest.raises(
        OmniError, match=r"seed \d+ draws what is not allowed; give the distribution ends: carpet.friction"
    ):
        [chosen.settings_of(seed) for seed in range(50)]


def test_studies_of_one_robot_refuse_distributions() -> None:
    with pytest.raises(OmniError, match=r"limit takes numbers, no distributions; give one for carpet.friction"):
        om.limit(made(carpet={"friction": {"uniform": [0.4, 0.9]}}))


def test_values_are_found_by_name() -> None:
    assert distributions.value(made().settings, "carpet.friction") == made().settings.carpet.friction

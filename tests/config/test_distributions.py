"""Drawn settings: their statistics, and their independence of controllers and other settings."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import omni_mj as om

DRAWS = 400
ROUTE = {"waypoints": [[0, 0], [0.2, 0.1]]}


def load(**sections: object) -> om.Scenario:
    return om.load_scenario("rect", plant="kinematic", reference=ROUTE, **sections)


@pytest.mark.parametrize(
    ("notation", "law"),
    [
        ({"uniform": [0.4, 0.9]}, stats.uniform(0.4, 0.5)),
        ({"normal": [0.6, 0.05]}, stats.norm(0.6, 0.05)),
        ({"normal": [0.6, 0.2, 0.3, 0.7]}, stats.truncnorm(-1.5, 0.5, 0.6, 0.2)),
    ],
)
def test_draws_follow_the_distribution(notation: dict[str, list[float]], law: Any) -> None:
    """Apply the Kolmogorov-Smirnov test at 1/1000; the fixed seeds make it deterministic."""
    scenario = load(carpet={"friction": notation})
    drawn = [scenario.settings_for_seed(seed).carpet.friction for seed in range(DRAWS)]
    assert stats.kstest(drawn, law.cdf).pvalue > 1e-3


def test_integers_and_choices_are_equally_likely() -> None:
    """Expect DRAWS / k draws of each of k values, within four binomial deviations."""
    scenario = load(
        radio={"delay_frames": {"uniform": [2, 6]}},
        wheels={"model": {"choice": ["rollers", "two-rollers"]}},
    )
    settings = [scenario.settings_for_seed(seed) for seed in range(DRAWS)]
    for values, options in (
        ([s.radio.delay_frames for s in settings], [2, 3, 4, 5, 6]),
        ([s.wheels.model for s in settings], ["rollers", "two-rollers"]),
    ):
        probability = 1 / len(options)
        counts = np.array([values.count(value) for value in options])
        assert counts.sum() == DRAWS
        assert np.abs(counts - DRAWS * probability).max() < 4 * np.sqrt(
            DRAWS * probability * (1 - probability)
        )


def test_settings_drawn_for_a_seed_are_independent() -> None:
    """Correlations of n independent draws have the deviation 1 / sqrt(n), also with other seeds."""
    uniform = {"uniform": [0.4, 0.9]}
    scenario = load(
        carpet={"friction": uniform},
        battery={"charge": uniform},
        body={"mass_kg": {"normal": [2.5, 0.1]}},
        radio={"delay_frames": {"uniform": [0, 9]}},
    )
    drawn = np.array(
        [
            (s.carpet.friction, s.battery.charge, s.body.mass_kg, s.radio.delay_frames)
            for s in map(scenario.settings_for_seed, range(DRAWS))
        ]
    )
    for shift in range(-3, 4):
        pairs = np.corrcoef(drawn, np.roll(drawn, shift, axis=0), rowvar=False)[:4, 4:]
        np.fill_diagonal(pairs, pairs.diagonal() * (shift != 0))
        assert np.abs(pairs).max() < 4 / np.sqrt(DRAWS), shift


def test_draws_depend_on_the_seed_only_and_are_recorded(tmp_path: Path) -> None:
    delays = {"uniform": [0, 9]}
    scenario = load(radio={"delay_frames": delays}, battery={"charge": {"choice": [0.4, 0.5]}})
    expected = [
        load(radio={"delay_frames": delays}).settings_for_seed(seed).radio.delay_frames
        for seed in (3, 4, 5)
    ]
    result = om.run(scenario, ["p", "flc"], seeds=range(3, 6))
    entry = result.summary()["scenarios"]["rect"]
    assert [draw["radio.delay_frames"] for draw in entry["drawn_parameters"]] == expected
    assert entry["settings"]["radio"]["delay_frames"] == delays
    alone = om.run(scenario.replace(seed=5), ["flc"]).frames()["x_m"].to_numpy()
    frames = result.frames()
    selected_rows = (frames["seed"].to_numpy() == 5) & (frames["controller"].to_numpy() == "flc")
    np.testing.assert_array_equal(frames["x_m"].to_numpy()[selected_rows], alone)
    (tmp_path / "again.toml").write_text(scenario.to_toml())
    again = om.load_scenario(tmp_path / "again.toml")
    assert again.to_toml() == scenario.to_toml()
    assert again.settings_for_seed(4) == scenario.settings_for_seed(4)
    simulation = om.Simulation(scenario, ["p"])
    simulation.reset(seed=7)
    assert simulation.rows[0].settings.radio == scenario.settings_for_seed(7).radio


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"carpet": {"friction": {"uniform": [0.9, 0.4]}}}, "low below high"),
        ({"carpet": {"friction": {"uniform": [0.4, 90.0]}}}, "carpet.friction must be"),
        ({"carpet": {"friction": {"normal": [0.4, 0]}}}, "deviation above 0"),
        ({"carpet": {"friction": {"poisson": [3]}}}, "uniform, normal, choice"),
        ({"carpet": {"fricton": {"uniform": [0.4, 0.9]}}}, "carpet.friction"),
        ({"wheels": {"model": {"uniform": [1, 2]}}}, "choice"),
        ({"wheels": {"model": {"choice": ["rollers", "square"]}}}, "wheels.model must be"),
        ({"carpet": {"friction": {"choice": []}}}, "choice ="),
        ({"world": {"start_poses": {"choice": [[[0, 0, 0]]]}}}, "world.start_poses is a list"),
    ],
)
def test_invalid_distributions_are_rejected(sections: dict[str, Any], words: str) -> None:
    with pytest.raises(om.OmniError, match=words):
        load(**sections)


def test_invalid_draws_and_studies_without_distributions_are_rejected() -> None:
    scenario = load(carpet={"friction": {"normal": [0.1, 5.0]}})
    with pytest.raises(
        om.OmniError, match=r"seed \d+ draws a value that is not allowed; .*carpet.friction"
    ):
        [scenario.settings_for_seed(seed) for seed in range(50)]
    with pytest.raises(
        om.OmniError, match=r"limit takes numbers, no distributions; .*carpet.friction"
    ):
        om.find_limit(scenario)

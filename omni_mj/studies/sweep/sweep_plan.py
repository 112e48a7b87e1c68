"""Plan of a sweep: the settings that vary, the points of their grid, and the shards of runs."""

import itertools
import json
import math
import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from omni_control.errors import OmniError, format_value
from omni_mj.config.distributions import SettingValue, replace_values
from omni_mj.config.reference_factory import build_timed_reference
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import find_setting
from omni_mj.config.toml_files import parse_value
from omni_mj.robot.numpy_and_jax_backends import choose_backend
from omni_mj.simulation.simulation import batch_key
from omni_mj.studies.run_scenario import check_memory, choose_shared_backend
from omni_mj.studies.sweep.process_checks import check_program

SWEEP_FILE = "sweep.json"  # the axes; written first, so a folder that contains it is resumed
MODEL_AXIS = "model.file"  # setting that names a file
BATCH_SIZE = 128  # robots that are simulated together
MAX_VALUES = 1000  # number of values of an axis


def check_axes(vary: Iterable[tuple[str, Iterable[Any]]]) -> dict[str, tuple[SettingValue, ...]]:
    """Return the axes of a sweep as a mapping from `section.field` to values.

    Args:
        vary: Settings `section.field` and their values.

    Raises:
        OmniError: A setting does not exist or is varied twice; or it has no values, more than
            `MAX_VALUES`, or a value twice.
    """
    axes: dict[str, tuple[SettingValue, ...]] = {}
    for name, values in vary:
        setting_type = find_setting(name).value_type
        plain = [value.item() if isinstance(value, np.generic) else value for value in values]
        if setting_type is float:
            plain = [float(value) if type(value) is int else value for value in plain]
        if not 1 <= len(plain) <= MAX_VALUES or len(set(plain)) != len(plain):
            raise OmniError(
                f"{name} must have 1 to {MAX_VALUES} values, each once, not {format_value(plain)}"
            )
        if name in axes:
            raise OmniError(f"{name} is varied twice; give all of its values in one --vary")
        axes[name] = tuple(plain)
    return axes


def parse_axis(text: str) -> tuple[str, Iterable[Any]]:
    """Parse an axis, such as `carpet.friction=0.3:1.0:8` or `a.b=1,2,4`.

    LOW:HIGH:N gives N values at equal distances, including both ends. Those of a setting that is an
    integer are rounded.

    Raises:
        OmniError: The text cannot be parsed, or there is no such setting.
    """
    name, _, values = (word.strip() for word in text.partition("="))
    setting = find_setting(name)
    parsed = [parse_value(word) for word in re.split("[:,]", values)]
    if ":" not in values:
        return name, parsed
    if not setting.is_number:
        raise OmniError(f"cannot read --vary {text}: {name} is no number; write {name}=A,B,C")
    is_range = all(type(value) in (int, float) and math.isfinite(value) for value in parsed)
    if not is_range or values.count(":") != 2 or type(parsed[2]) is not int:
        raise OmniError(f"cannot read --vary {text}; write section.field=LOW:HIGH:N or A,B,C")
    low, high, n_values = parsed
    max_values = MAX_VALUES
    if setting.value_type is int:
        if type(low) is not int or type(high) is not int:
            raise OmniError(f"cannot read --vary {text}: {name} is an integer; so are its ends")
        max_values = min(MAX_VALUES, abs(high - low) + 1)
    if not 2 <= n_values <= max_values:
        raise OmniError(
            f"cannot read --vary {text}: the number of values must be from 2 to {max_values}, "
            f"got {n_values}"
        )
    points = np.linspace(low, high, n_values)
    if setting.value_type is int:
        return name, [round(x) for x in points.tolist()]
    return name, [float(f"{x:.12g}") for x in points]


class Shard(NamedTuple):
    """Runs that are simulated in one batch.

    Attributes:
        number: Index among all shards.
        runs: Index of a point, and a seed, of each run.
    """

    number: int
    runs: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class SweepPlan:
    """A sweep before it is run.

    Attributes:
        scenario: Scenario with controllers, seeds and all settings that do not vary.
        axes: Settings that vary, section.field -> values; empty if seeds draw settings.
        batch_size: Largest number of robots that are simulated together.

    Raises:
        OmniError: The values at a point are not valid, or nothing varies.
    """

    scenario: Scenario
    axes: Mapping[str, tuple[SettingValue, ...]]
    batch_size: int

    def __post_init__(self) -> None:
        """Check the settings at every point, and choose one backend for all shards."""
        if self.batch_size < 1:
            raise OmniError(f"batch size must be at least 1, not {self.batch_size}")
        if not self.axes and not self.scenario.distributions:
            raise OmniError(
                "nothing varies; name a setting, such as --vary carpet.friction=0.3:1.0:8"
            )
        scenario = choose_shared_backend(self.scenario, self.batch_size)
        object.__setattr__(self, "scenario", scenario)
        for point in self.point_scenarios:  # raises OmniError if a point is not valid
            choose_backend(point.settings.physics.backend, point.plant, n_robots=0, n_frames=0)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without cached properties, which other processes compute again."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def points(self) -> list[dict[str, SettingValue]]:
        """Values of the axes at each point of the grid; the last axis changes fastest."""
        grid = itertools.product(*self.axes.values())
        return [dict(zip(self.axes, values, strict=True)) for values in grid]

    @cached_property
    def point_scenarios(self) -> list[Scenario]:
        """Scenario at each point."""
        return [self.scenario_at(point) for point in range(len(self.points))]

    def scenario_at(self, point: int) -> Scenario:
        """Return the scenario at a point.

        Raises:
            OmniError: A value is not valid by itself, or together with the others.
        """
        values = self.points[point]
        distributions = {
            name: distribution
            for name, distribution in self.scenario.distributions.items()
            if name not in values
        }
        settings = replace_values(self.scenario.settings, values)
        return self.scenario.replace(settings=settings, distributions=distributions)

    @cached_property
    def shards(self) -> list[Shard]:
        """All shards. The controllers of a run are in the same shard."""
        groups: dict[Hashable, list[tuple[int, int]]] = {}
        for point, scenario in enumerate(self.point_scenarios):
            for seed in scenario.seed_list:
                key = batch_key(scenario.plant, scenario.settings_for_seed(seed))
                groups.setdefault(key, []).append((point, seed))
        batches = []
        for runs in groups.values():
            settings = self.point_scenarios[runs[0][0]].settings
            robots_per_run = len(self.scenario.controllers) * len(settings.world.start_poses)
            size = max(1, self.batch_size // robots_per_run)
            batches += [tuple(runs[i : i + size]) for i in range(0, len(runs), size)]
        return [Shard(number, runs) for number, runs in enumerate(batches)]

    def split_shards(self, shards: Sequence[Shard], processes: int) -> list[Shard]:
        """Return shards or, if there are fewer than processes, parts of them with their numbers.

        Only the numpy backend gives the same bits for any number of robots.
        """
        is_divisible = all(
            point.settings.physics.backend == "numpy" for point in self.point_scenarios
        )
        if not shards or len(shards) >= processes or not is_divisible:
            return list(shards)
        tasks_per_shard = math.ceil(processes / len(shards))
        tasks = []
        for number, runs in shards:
            size = math.ceil(len(runs) / tasks_per_shard)
            tasks += [Shard(number, runs[i : i + size]) for i in range(0, len(runs), size)]
        return tasks

    @cached_property
    def frames(self) -> int:
        """Number of frames of the longest run."""
        return max(
            build_timed_reference(scenario.settings).frames for scenario in self.point_scenarios
        )

    def check(self, processes: int) -> None:
        """Check the number of processes, the memory that they need, and what they import.

        Raises:
            OmniError: The processes cannot run the sweep.
        """
        if processes < 1:
            raise OmniError(f"jobs must be at least 1, not {processes}")
        if processes > 1:
            check_program(self.scenario.controllers)
        runs = max(len(shard.runs) for shard in self.shards)
        check_memory(processes * runs * len(self.scenario.controllers), self.frames)

    @property
    def recorded_scenarios(self) -> list[Scenario]:
        """The scenario, and one for each model that varies, from which provenance is recorded."""
        variants = [
            self.scenario.replace(
                name=f"{self.scenario.name}-{i}",
                settings=replace_values(self.scenario.settings, {MODEL_AXIS: file}),
            )
            for i, file in enumerate(self.axes.get(MODEL_AXIS, ()))
        ]
        return [self.scenario, *variants]

    @property
    def files(self) -> dict[str, str]:
        """Texts of the files that identify a sweep, by name; equal for plans of the same sweep."""
        content = {"axes": self.axes, "batch_size": self.batch_size}
        sweep_json = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        return {SWEEP_FILE: sweep_json, "scenario.toml": self.scenario.to_toml()}

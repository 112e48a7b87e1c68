"""What a sweep varies, and the shards in which its runs are computed, one by one, anywhere."""

import json
import re
import tomllib
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from omni_control.errors import OmniError, suggest_names
from omni_mj.config.distributions import put
from omni_mj.config.reference_factory import timed
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import every_setting
from omni_mj.config.validation import shown
from omni_mj.simulation.simulation import batch_key, seeds_share_batch
from omni_mj.studies.run_scenario import choose_shared_backend
from omni_mj.studies.study_runner import check_memory

Value = int | float | str | bool
BATCH_SIZE = 128  # robots that are simulated at once
MAX_VALUES = 1000  # of an axis


def check_axes(
    vary: Mapping[str, Iterable[Any]] | Iterable[tuple[str, Iterable[Any]]],
) -> dict[str, tuple[Value, ...]]:
    """Return settings, section.field, and their values in order, if these are allowed.

    Raises:
        OmniError: There is no such setting, it has no values, too many, or one twice, or it is
            varied twice.
    """
    result: dict[str, tuple[Value, ...]] = {}
    for name, values in vary.items() if isinstance(vary, Mapping) else vary:
        kind = _kind(name)
        plain = [value.item() if isinstance(value, np.generic) else value for value in values]
        if kind is float:
            plain = [float(value) if type(value) is int else value for value in plain]
        if not 1 <= len(plain) <= MAX_VALUES or len(set(plain)) != len(plain):
            raise OmniError(
                f"{name} must have 1 to {MAX_VALUES} values, each once, not {shown(plain)}"
            )
        if name in result:
            raise OmniError(f"{name} is varied twice; give all of its values at once")
        result[name] = tuple(plain)
    return result


def parse_axis(text: str) -> tuple[str, Iterable[Any]]:
    """Read an axis of the command line: `carpet.friction=0.3:1.0:8`, `radio.delay_frames=0:12:2`, `a.b=1,2,4`.

    The third number says how many values there are, both ends among them; of whole numbers it is
    the step.

    Raises:
        OmniError: It cannot be read, or there is no such setting.
    """
    name, _, values = (part.strip() for part in text.partition("="))
    kind, parts = _kind(name), [_value(part.strip()) for part in re.split("[:,]", values)]
    if ":" not in values:
        return name, parts
    try:
        low, high, last = parts
        if kind is int:
            return name, range(low, high + 1, last)
        return name, [float(f"{x:.12g}") for x in np.linspace(low, high, min(last, MAX_VALUES + 1))]
    except (TypeError, ValueError):
        raise OmniError(
            f"cannot read --vary {text}; write section.field=LOW:HIGH:N, LOW:HIGH:STEP of whole numbers, or A,B,C"
        ) from None


class Shard(NamedTuple):
    """A shard: runs that one batch can hold.

    Attributes:
        number: Among all shards, in their order.
        runs: Number of a point, and a seed.
    """

    number: int
    runs: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class SweepPlan:
    """A sweep, before it is run.

    Attributes:
        scenario: With its controllers, seeds and all that is not varied.
        axes: What is varied, section.field -> values; nothing if seeds draw settings.
        batch_size: Robots that are simulated at once, at most.

    Raises:
        OmniError: A point is not allowed, or nothing is varied or drawn.
    """

    scenario: Scenario
    axes: Mapping[str, tuple[Value, ...]]
    batch_size: int = BATCH_SIZE

    def __post_init__(self) -> None:
        """Check every point, and choose the backend, once for all shards."""
        if self.batch_size < 1:
            raise OmniError(f"robots at once must be at least 1, not {self.batch_size}")
        if not self.axes and not self.scenario.distributions:
            raise OmniError("nothing varies: --vary carpet.friction=0.3:1.0:8 varies a setting")
        object.__setattr__(self, "scenario", choose_shared_backend(self.scenario, self.batch_size))
        _ = self.there

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process is sent, without what follows from it."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def points(self) -> list[dict[str, Value]]:
        """Return the values of the axes at all points, the last axis changing first."""
        return [dict(zip(self.axes, point, strict=True)) for point in product(*self.axes.values())]

    @cached_property
    def there(self) -> list[Scenario]:
        """Return the scenario at each point."""
        return [self.at(point) for point in range(len(self.points))]

    def at(self, point: int) -> Scenario:
        """Return the scenario at a point.

        Raises:
            OmniError: A value is not allowed, there or together with the others.
        """
        drawn = {
            name: law
            for name, law in self.scenario.distributions.items()
            if name not in self.points[point]
        }
        return self.scenario.replace(
            settings=put(self.scenario.settings, self.points[point]), distributions=drawn
        )

    @cached_property
    def shards(self) -> list[Shard]:
        """Return the shards: runs whose robots one batch can hold, all controllers of a run in the same."""
        groups: dict[Hashable, list[tuple[int, int]]] = {}
        for point, scenario in enumerate(self.there):
            for seed in scenario.seed_list:
                settings = (
                    scenario.settings if seeds_share_batch(scenario) else scenario.settings_of(seed)
                )
                groups.setdefault(batch_key(scenario.plant, settings), []).append((point, seed))
        parts = []
        for runs in groups.values():
            n_places = len(self.there[runs[0][0]].settings.world.start_poses)
            size = max(1, self.batch_size // (len(self.scenario.controllers) * n_places))
            parts += [tuple(runs[i : i + size]) for i in range(0, len(runs), size)]
        return [Shard(number, runs) for number, runs in enumerate(parts)]

    @cached_property
    def frames(self) -> int:
        """Return the frames of the longest run."""
        return max(timed(scenario.settings).frames for scenario in self.there)

    def check(self, processes: int) -> None:
        """Raise OmniError if shards cannot be run in so many processes at once, or do not fit into memory."""
        if processes < 1:
            raise OmniError(f"jobs must be at least 1, not {processes}")
        robots = max(len(job.runs) for job in self.shards) * len(self.scenario.controllers)
        check_memory(processes * robots, self.frames)

    @property
    def files(self) -> dict[str, str]:
        """Return by name the files that say what is run, the same for plans of the same sweep."""
        content = {"axes": self.axes, "batch_size": self.batch_size}
        described = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        return {"sweep.json": described, "scenario.toml": self.scenario.to_toml()}


def _kind(name: str) -> Any:
    """Return the type of a setting's values."""
    known = {setting.full: setting.kind for setting in every_setting()}
    if name not in known:
        raise OmniError(f"unknown setting {name}; {suggest_names(name, list(known))}")
    return known[name]


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except ValueError:
        return text

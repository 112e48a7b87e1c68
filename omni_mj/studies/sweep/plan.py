"""What a sweep varies, and the shards in which its runs are computed, one by one, anywhere."""

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Self

import numpy as np

from omni_control.errors import OmniError, choose
from omni_mj.files import text_of, write
from omni_mj.scenarios.checking import Setting, shown
from omni_mj.scenarios.controllers import written
from omni_mj.scenarios.references import timed
from omni_mj.scenarios.rows import Row, table
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.scenarios.settings import every_setting
from omni_mj.simulate.simulation import alike, all_alike
from omni_mj.studies import cost
from omni_mj.studies.run import with_kernel

Value = int | float | str | bool
AT_ONCE = 128  # robots that are simulated at once
PROGRAM_BYTES = 300e6  # of memory of a process, whatever it simulates
FORMAT = 1
WRITE = "write section.field=LOW:HIGH:N, LOW:HIGH:STEP of whole numbers, or A,B,C"
MOST = 1000  # values of an axis


@dataclass(frozen=True)
class Axis:
    """A setting that is varied.

    Attributes:
        name: section.field.
        values: In their order.
    """

    name: str
    values: tuple[Value, ...]

    @classmethod
    def of(cls, name: str, values: Iterable[Any]) -> Self:
        """Return an axis whose values are allowed.

        Raises:
            OmniError: There is no such setting, or it has no values, too many, or one twice.
        """
        kind, own = _declared(name).kind, [v.item() if isinstance(v, np.generic) else v for v in values]
        if kind is float:
            own = [float(v) if isinstance(v, int) and not isinstance(v, bool) else v for v in own]
        if not 1 <= len(own) <= MOST or len(set(own)) != len(own):
            raise OmniError(f"{name} must have 1 to {MOST} values, each once, not {shown(own)}")
        return cls(name, tuple(own))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an axis of the command line: `carpet.friction=0.3:1.0:8`, `radio.delay_frames=0:12:2`, `a.b=1,2,4`.

        The third number says how many values there are, both ends among them; of whole numbers it is the step.

        Raises:
            OmniError: It cannot be read, or there is no such setting.
        """
        name, equals, values = (part.strip() for part in text.partition("="))
        if not equals or not values:
            raise OmniError(f"cannot read --vary {text}; {WRITE}")
        declared = _declared(name)
        parts = [_value(part) for part in values.split(":" if ":" in values else ",")]
        if ":" not in values:
            return cls.of(name, parts)
        numbers = [part for part in parts if isinstance(part, (int, float)) and not isinstance(part, bool)]
        if len(parts) != 3 or len(numbers) != 3 or not declared.number:
            raise OmniError(f"cannot read --vary {text}; {WRITE}")
        low, high, last = numbers
        if declared.kind is int:
            if any(isinstance(number, float) for number in numbers) or last < 1 or low > high:
                raise OmniError(f"--vary {text}: {name} is a whole number: LOW:HIGH:STEP, with a step of at least 1")
            return cls.of(name, range(int(low), int(high) + 1, int(last)))
        if not isinstance(last, int) or last < 2 or low >= high:
            raise OmniError(f"--vary {text}: LOW:HIGH:N, with N values of which there are at least 2")
        return cls.of(name, [float(f"{value:.12g}") for value in np.linspace(low, high, min(last, MOST + 1))])


def axes(vary: Mapping[str, Iterable[Any]] | Sequence[Axis]) -> tuple[Axis, ...]:
    """Return the axes of a mapping from settings to values, or as they are.

    Raises:
        OmniError: See `Axis.of`; or a setting is varied twice.
    """
    found = tuple(Axis.of(*item) for item in vary.items()) if isinstance(vary, Mapping) else tuple(vary)
    names = [axis.name for axis in found]
    if len(set(names)) != len(names):
        raise OmniError(f"{max(names, key=names.count)} is varied twice; give all of its values at once")
    return found


@dataclass(frozen=True)
class Job:
    """A shard: runs that one batch can hold.

    Attributes:
        number: Among all shards, in their order.
        runs: Number of a point, and a seed.
    """

    number: int
    runs: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Plan:
    """A sweep, before it is run.

    Attributes:
        scenario: With its controllers, seeds and all that is not varied.
        axes: What is varied.
        at_once: Robots that are simulated at once, at most.
        design: Method and samples, where the axes' values are taken together, the first of each, the second, rather
            than all combinations of them; see `sensitivity`.

    Raises:
        OmniError: A point is not allowed.
    """

    scenario: Scenario
    axes: tuple[Axis, ...]
    at_once: int = AT_ONCE
    design: tuple[str, int] | None = None

    def __post_init__(self) -> None:
        """Check every point, and choose the kernel, once for all shards."""
        if self.at_once < 1:
            raise OmniError(f"robots at once must be at least 1, not {self.at_once}")
        object.__setattr__(self, "scenario", with_kernel(self.scenario, self.at_once))
        _ = self.there

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process is sent: what was asked for, and not what follows from it."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def points(self) -> list[dict[str, Value]]:
        """Return all points, the last axis changing first."""
        values = [axis.values for axis in self.axes]
        combined = zip(*values, strict=True) if self.design else product(*values)
        names = [axis.name for axis in self.axes]
        return [dict(zip(names, point, strict=True)) for point in combined]

    @cached_property
    def there(self) -> list[Scenario]:
        """Return the scenario at each point."""
        return [self.at(point) for point in range(len(self.points))]

    def at(self, point: int) -> Scenario:
        """Return the scenario at a point.

        Raises:
            OmniError: A value is not allowed, there or together with the others.
        """
        sections: dict[str, dict[str, Value]] = {}
        for name, value in self.points[point].items():
            section, field = name.split(".")
            sections.setdefault(section, {})[field] = value
        drawn = {name: each for name, each in self.scenario.distributions.items() if name not in self.points[point]}
        return self.scenario.replace(settings=self.scenario.settings.replace(**sections), distributions=drawn)

    @cached_property
    def jobs(self) -> list[Job]:
        """Return the shards: runs whose robots one batch can hold, all controllers of a run in the same."""
        groups: dict[Any, list[tuple[int, int]]] = {}
        for point, scenario in enumerate(self.there):
            shared = alike(scenario.plant, scenario.settings) if all_alike(scenario) else None
            for seed in scenario.seed_list:
                key = shared if shared is not None else alike(scenario.plant, scenario.settings_of(seed))
                groups.setdefault(key, []).append((point, seed))
        parts = []
        for runs in groups.values():
            places = len(self.there[runs[0][0]].settings.world.places)
            size = max(1, self.at_once // (len(self.scenario.controllers) * places))
            parts += [tuple(runs[i : i + size]) for i in range(0, len(runs), size)]
        return [Job(number, runs) for number, runs in enumerate(parts)]

    def rows(self, job: Job) -> list[Row]:
        """Return the robots of a shard, a world for each run and controller.

        Raises:
            OmniError: What a seed draws is not allowed.
        """
        scenarios = {point: self.at(point) for point in dict.fromkeys(point for point, _ in job.runs)}
        found: list[Row] = []
        for point, seed in job.runs:
            there = scenarios[point]
            for row in table(there.labels, [seed], there.settings_of, there.robot):
                world = found[-1].world + (row.place == 0) if found else 0
                found.append(Row(world, row.place, row.controller, row.seed, row.settings, row.robot))
        return found

    @property
    def key(self) -> tuple[Any, ...]:
        """Return what two plans of the same sweep have in common."""
        return self.scenario.to_toml(), self.axes, self.at_once, self.design

    @cached_property
    def frames(self) -> int:
        """Return the frames of the longest run."""
        return max(timed(scenario.settings).frames for scenario in self.there)

    @cached_property
    def bytes(self) -> int:
        """Return the memory that a process takes, about: it grows with robots at once and frames, not with runs."""
        places = max(len(scenario.settings.world.places) for scenario in self.there)
        robots = max(len(job.runs) for job in self.jobs) * len(self.scenario.controllers) * places
        return int(PROGRAM_BYTES + robots * self.frames * cost.FRAME_BYTES)

    def check_memory(self, processes: int = 1) -> None:
        """Raise OmniError, with how many robots at once would fit, if so many shards at once do not."""
        free, needed = cost.free_b(), processes * self.bytes
        if free is not None and needed > free:
            share = (free / processes - PROGRAM_BYTES) / (self.bytes - PROGRAM_BYTES)
            fewer = f"--at-once {max(1, int(self.at_once * share))}" if share > 0 else "--jobs"
            raise OmniError(
                f"{processes * self.at_once} robots at once for {self.frames} frames need some {needed / 1e9:.1f} GB,"
                f" and {free / 1e9:.1f} GB of memory are free; give fewer: {fewer}"
            )

    def save(self, folder: Path) -> None:
        """Write sweep.json and scenario.toml, all that `read` needs."""
        content = {
            "format": FORMAT,
            "controllers": [written(kind) for kind in self.scenario.controllers],
            "axes": [{"name": axis.name, "values": list(axis.values)} for axis in self.axes],
            "at_once": self.at_once,
        } | ({"design": list(self.design)} if self.design else {})
        write(folder / "scenario.toml", self.scenario.to_toml())
        write(folder / "sweep.json", json.dumps(content, indent=1, ensure_ascii=False) + "\n")

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Return the plan of a sweep that was begun in a folder.

        Raises:
            OmniError: There is none, or one that cannot be read.
        """
        path = folder / "sweep.json"
        try:
            content = json.loads(text_of(path))
            if content["format"] != FORMAT:
                raise OmniError(f"{path} is of format {content['format']!r}; this version reads {FORMAT}")
            method, samples = content.get("design") or (None, 0)
            axis = Axis if method else Axis.of
            grid = tuple(axis(each["name"], tuple(each["values"])) for each in content["axes"])
            scenario = load(str(folder / "scenario.toml"), code=True, head={"controllers": content["controllers"]})
            if not grid:
                raise ValueError("it varies nothing")
            return cls(scenario, grid, int(content["at_once"]), (method, int(samples)) if method else None)
        except OSError as error:
            raise OmniError(f"{folder} holds no sweep: {path.name}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise OmniError(f"{path} is not a sweep's: {error}") from None


def _declared(name: str) -> Setting:
    known = {setting.full: setting for setting in every_setting()}
    if name not in known:
        raise OmniError(f"unknown setting {name}; {choose(name, list(known))}")
    return known[name]


def _value(text: str) -> Value:
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except ValueError:
        return text.strip()
    if not isinstance(value, (int, float, str, bool)):
        raise OmniError(f"{text.strip()} is no single value; {WRITE}")
    return value

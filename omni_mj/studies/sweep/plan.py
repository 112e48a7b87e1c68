"""What a sweep consists of: points, seeds and controllers, cut into shards that are run one by one, anywhere."""

import json
import os
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from omni_control.errors import OmniError
from omni_mj.files import text_of, write
from omni_mj.scenarios.controllers import written
from omni_mj.scenarios.references import timed
from omni_mj.scenarios.rows import Row, table
from omni_mj.scenarios.scenario import Scenario, load
from omni_mj.simulate.alike import alike, all_alike
from omni_mj.studies.sweep.grid import Axis, Value, at, made, points, together

AT_ONCE = 128  # robots that are simulated at once
# Of memory, about; measured (docs/scale.md).
PROGRAM_BYTES = 300e6  # of a process, whatever it simulates
FRAME_BYTES = 1200  # of a robot-frame in the log, with what is made of it to measure and its reference
FORMAT = 1


@dataclass(frozen=True)
class Job:
    """Some of a sweep, that one batch can hold.

    Args:
        number: among all, in their order.
        runs: number of a point, and a seed.
    """

    number: int
    runs: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Plan:
    """A sweep, before it is run.

    Args:
        scenario: with its controllers, seeds and all that is not varied.
        axes: what is varied.
        at_once: robots that are simulated at once, at most; results do not depend on it.
        design: method and samples, where the axes' values are taken together, the first of each, the second, rather
            than all combinations of them; see `sensitivity`.

    Raises:
        OmniError: a point is not allowed.
    """

    scenario: Scenario
    axes: tuple[Axis, ...]
    at_once: int = AT_ONCE
    design: tuple[str, int] | None = None

    def __post_init__(self) -> None:
        if self.at_once < 1:
            raise OmniError(f"robots at once must be at least 1, not {self.at_once}")
        _ = self.there  # every point is checked before anything is run

    def __getstate__(self) -> dict[str, Any]:
        """What another process is sent: what was asked for, and not what follows from it."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def points(self) -> list[dict[str, Value]]:
        """All points, in order."""
        return together(self.axes) if self.design else points(self.axes)

    @cached_property
    def there(self) -> list[Scenario]:
        """The scenario at each point."""
        return [at(self.scenario, point) for point in self.points]

    @cached_property
    def jobs(self) -> list[Job]:
        """The shards: runs whose robots one batch can hold, all controllers of a run in the same."""
        groups: dict[Any, list[tuple[int, int]]] = {}
        for number, each in enumerate(self.there):
            if all_alike(each):
                group = groups.setdefault(alike(each.plant, each.settings), [])
                group += [(number, seed) for seed in each.seed_list]
                continue
            for seed in each.seed_list:
                groups.setdefault(alike(each.plant, each.settings_of(seed)), []).append((number, seed))
        jobs: list[Job] = []
        for runs in groups.values():
            places = len(self.there[runs[0][0]].settings.world.places)
            size = max(1, self.at_once // (len(self.scenario.controllers) * places))
            jobs += [Job(len(jobs) + i // size, tuple(runs[i : i + size])) for i in range(0, len(runs), size)]
        return [Job(number, job.runs) for number, job in enumerate(jobs)]

    def scenarios(self, job: Job) -> dict[int, Scenario]:
        """The scenario at each point of a shard; what knows it alone need not make those of all others."""
        numbers = dict.fromkeys(point for point, _ in job.runs)
        return {point: at(self.scenario, self.points[point]) for point in numbers}

    def rows(self, job: Job) -> list[Row]:
        """The robots of a shard, a world for each run and controller.

        Raises:
            OmniError: what a seed draws is not allowed.
        """
        found: list[Row] = []
        scenarios = self.scenarios(job)
        for point, seed in job.runs:
            there = scenarios[point]
            for row in table(there.labels, [seed], there.settings_of, there.robot):
                worlds = found[-1].world + (row.place == 0) if found else 0
                found.append(Row(worlds, row.place, row.controller, row.seed, row.settings, row.robot))
        return found

    @property
    def key(self) -> tuple[Any, ...]:
        """What two plans of the same sweep have in common."""
        return self.scenario.to_toml(), self.axes, self.at_once, self.design

    @property
    def robots(self) -> int:
        """How many there are in all."""
        places = sum(len(each.settings.world.places) for each in self.there)
        return places * self.scenario.seeds * len(self.scenario.controllers)

    @cached_property
    def frames(self) -> int:
        """Of the longest run."""
        return max(len(timed(each.settings).poses) for each in self.there)

    @cached_property
    def bytes(self) -> int:
        """Of memory that a process takes, about: it grows with robots at once and frames, not with runs."""
        largest = max(len(job.runs) for job in self.jobs)
        places = max(len(scenario.settings.world.places) for scenario in self.there)
        robots = largest * len(self.scenario.controllers) * places
        return int(PROGRAM_BYTES + robots * self.frames * FRAME_BYTES)

    def check_memory(self, jobs: int = 1) -> None:
        """See that as many shards at once fit.

        Raises:
            OmniError: it does not; how many robots at once would.
        """
        have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else 0
        needed = jobs * self.bytes
        if have and needed > 0.8 * have:
            room = 0.5 * have / jobs - PROGRAM_BYTES
            fits = int(self.at_once * room / (self.bytes - PROGRAM_BYTES))
            fewer = "--jobs" if fits < 1 < jobs else f"--at-once {max(1, fits)}"
            raise OmniError(
                f"{jobs * self.at_once} robots at once for {self.frames} frames need some {needed / 1e9:.1f} GB, and"
                f" there are {have / 1e9:.1f}; give fewer: {fewer}"
            )

    def save(self, folder: Path) -> None:
        """Write sweep.json and scenario.toml, all that `read` needs."""
        content = {
            "format": FORMAT,
            "controllers": [written(kind) for kind in self.scenario.controllers],
            "axes": [{"name": each.name, "values": list(each.values)} for each in self.axes],
            "at_once": self.at_once,
        } | ({"design": list(self.design)} if self.design else {})
        write(folder / "scenario.toml", self.scenario.to_toml())
        write(folder / "sweep.json", json.dumps(content, indent=1, ensure_ascii=False) + "\n")

    @classmethod
    def read(cls, folder: Path) -> Self:
        """The plan of a sweep that was begun in a folder.

        Raises:
            OmniError: there is none, or one that cannot be read.
        """
        path = folder / "sweep.json"
        try:
            content = json.loads(text_of(path))
            if content["format"] != FORMAT:
                raise OmniError(f"{path} is of format {content['format']!r}; this version reads {FORMAT}")
            method, samples = content.get("design") or (None, 0)
            axis = Axis if method else made
            grid = tuple(axis(each["name"], tuple(each["values"])) for each in content["axes"])
            chosen = load(str(folder / "scenario.toml"), code=True, head={"controllers": content["controllers"]})
            if not grid:
                raise ValueError("it varies nothing")
            return cls(chosen, grid, int(content["at_once"]), (method, int(samples)) if method else None)
        except OSError as error:
            raise OmniError(f"{folder} holds no sweep: {path.name}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise OmniError(f"{path} is not a sweep's: {error}") from None

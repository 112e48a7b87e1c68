"""`omni_mj/Track-v0`: one robot as an environment of Gymnasium, and many as a vector of them on one batch."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.gym import frames
from omni_mj.gym.episodes import LOST_M, Episodes, Outcome
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.scenario import scenario as made
from omni_mj.scenarios.settings import FRAME_RATE_HZ

Observations = NDArray[Any]  # of float32
LAST_SEED = 2**63 - 1
_MODES = "NextStep", "Disabled"


class Track(gymnasium.Env[Observations, Observations]):
    """A robot that is to follow the reference of a scenario; see docs/gym.md.

    Args:
        scenario: or its name, or its file. What it draws from distributions is drawn for each episode.
        memory: how many of the commands sent are observed. [as many as may be in flight, and one]
        lost_m: how far off its reference a robot is lost, m.
        changes: of a scenario that is named: plant, robot, and sections of settings, as `om.scenario` takes them.

    Raises:
        OmniError: something is unknown or not allowed.
    """

    metadata = {"render_modes": [], "render_fps": round(FRAME_RATE_HZ)}  # noqa: RUF012 - as the base class has it

    def __init__(
        self,
        scenario: Scenario | str = "rect",
        *,
        memory: int | None = None,
        lost_m: float = LOST_M,
        render_mode: None = None,
        **changes: Any,
    ) -> None:
        _check_mode(render_mode)
        self._episodes = Episodes(_chosen(scenario, changes), 1, memory, lost_m)
        self.observation_space, self.action_space = _spaces(self._episodes)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin an episode: with a seed, the run that `omni-mj run --seed` drives; without, the next that it draws."""
        super().reset(seed=seed)
        number = _next(self.np_random) if seed is None else seed
        self._episodes.begin(np.array([0]), [number])
        return self._episodes.seen[0].copy(), {"seed": number}

    def step(self, action: Any) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Go on by a frame, 1/60 s."""
        found = self._episodes.go_on(np.asarray(action, float)[None])
        info = {name: float(values[0]) for name, values in _told(found).items()}
        ends = bool(found.terminated[0]), bool(found.truncated[0])
        return self._episodes.seen[0].copy(), float(found.reward[0]), *ends, info


class Tracks(VectorEnv[Observations, Observations, NDArray[Any]]):
    """Many robots as `Track` has one, simulated together; to the bit what as many of these are, one by one.

    Robots whose episodes began in the same frame are one batch, which is what makes them fast.

    Args:
        num_envs: robots.
        scenario, memory, lost_m, changes: see `Track`.
        autoreset_mode: when an episode that has ended is followed by the next: with the next step (the action of which
            is ignored), or when `reset` says so. A robot whose episode has ended until then stays
            where it is and is rewarded with 0.

    Raises:
        OmniError: something is unknown or not allowed.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Scenario | str = "rect",
        *,
        memory: int | None = None,
        lost_m: float = LOST_M,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
        **changes: Any,
    ) -> None:
        _check_mode(render_mode)
        if num_envs < 1:
            raise OmniError(f"num_envs must be at least 1, not {num_envs}")
        mode = getattr(autoreset_mode, "value", autoreset_mode)
        if mode not in _MODES:
            raise OmniError(f"autoreset_mode must be one of {', '.join(_MODES)}, not {mode}")
        self.autoreset_mode = AutoresetMode(mode)
        self.num_envs = num_envs
        self.metadata = {**Track.metadata, "autoreset_mode": self.autoreset_mode}
        self._episodes = Episodes(_chosen(scenario, changes), num_envs, memory, lost_m)
        self.single_observation_space, self.single_action_space = _spaces(self._episodes)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._random: list[np.random.Generator | None] = [None] * num_envs

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin an episode of each robot, or of those where `options["reset_mask"]`, (num_envs,), says so.

        Args:
            seed: of the first; the others' count up from it. Or one for each.
            options: see above.

        Raises:
            OmniError: not as many seeds as robots, or a mask that is none of them.
        """
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None and len(seeds) != self.num_envs:
            raise OmniError(f"{self.num_envs} environments need as many seeds, not {len(seeds)}")
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise OmniError(f"reset_mask must be ({self.num_envs},) True and False, at least one True")
        info = self._begin(np.flatnonzero(mask), seeds)
        return self._episodes.seen.copy(), info

    def step(self, actions: Any) -> tuple[Observations, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Go on by a frame, 1/60 s."""
        before = self._episodes.ended
        found = self._episodes.go_on(actions)
        info = {} if before.all() else _told(found) | {f"_{name}": ~before for name in _told(found)}
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and before.any():
            info |= self._begin(np.flatnonzero(before))
            found.terminated[before] = found.truncated[before] = False
        return self._episodes.seen.copy(), found.reward, found.terminated, found.truncated, info

    def _begin(self, robots: NDArray[np.intp], seeds: Sequence[int | None] | None = None) -> dict[str, Any]:
        """Begin episodes of these robots; what is said of them."""
        numbers = np.zeros(self.num_envs, np.int64)
        for i in robots.tolist():
            given = None if seeds is None else seeds[i]
            if given is not None or self._random[i] is None:
                self._random[i], _ = seeding.np_random(given)
            numbers[i] = _next(self._random[i]) if given is None else given
        self._episodes.begin(robots, numbers[robots].tolist())
        begun = np.zeros(self.num_envs, bool)
        begun[robots] = True
        return {"seed": numbers, "_seed": begun}


def _chosen(scenario: Scenario | str, changes: dict[str, Any]) -> Scenario:
    if isinstance(scenario, Scenario):
        if changes:
            raise OmniError(f"{', '.join(changes)}: changes are made to a scenario that is named; make them in yours")
        return scenario
    return made(scenario, **changes)


def _check_mode(render_mode: None) -> None:
    if render_mode is not None:
        raise OmniError(f"render_mode = {render_mode!r}: there is none; record or film a run in place of it")


def _spaces(episodes: Episodes) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    shape = episodes.seen.shape[1:]
    seen = gymnasium.spaces.Box(-frames.HIGHEST, frames.HIGHEST, shape, np.float32)
    return seen, gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)


def _next(random: np.random.Generator | None) -> int:
    """The seed of the next episode."""
    assert random is not None, "made when the first was begun"
    return int(random.integers(LAST_SEED))


def _told(found: Outcome) -> dict[str, NDArray[Any]]:
    return {"distance_m": found.distance, "heading_error_rad": found.turned}

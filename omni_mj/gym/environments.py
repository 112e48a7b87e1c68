"""`omni_mj/Track-v0`: robots that each follow the reference of a scenario, commanded from outside."""

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import PerRobotReference
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.config.settings import FRAME_RATE_HZ, PERIOD_S, Settings
from omni_mj.gym import observations
from omni_mj.simulation.simulation import Simulation, batch_key

ARM_M = 0.09  # the league's largest radius of a robot: so far its hull is off per radian of heading
LOST_M = 1.0
LONGEST_MEMORY = 600  # frames
LAST_SEED = 2**63 - 1
Numbers = NDArray[Any]
Bools = NDArray[np.bool_]


class ExternalController(Controller):
    """Holds the place of a controller where commands come from outside; it is never asked."""

    history_length: int = 1  # frames

    def __init__(self, model: object, reference: object, n: int) -> None:
        super().__init__(model, reference, n)  # type: ignore[arg-type]
        self.memory_frames = max(self.history_length, self.memory_frames)


class EpisodeBatch:
    """Robots whose episodes began in the same frame: the rows of one simulation.

    Args:
        simulation: Theirs.
        robots: Their numbers; -1 for one that has begun another episode since.
    """

    def __init__(self, simulation: Simulation, robots: NDArray[np.intp]) -> None:
        self.simulation, self.robots, own = simulation, robots, simulation.references
        self.reference = own[0] if all(each is own[0] for each in own) else PerRobotReference(own)
        self.last = np.array([each.frames - 1 for each in own])
        control = [row.settings.control for row in simulation.rows]
        self.limits = np.array(
            [[c.max_speed_m_s, c.max_speed_m_s, c.max_turn_rate_rad_s] for c in control]
        )


class TrackVectorEnv(VectorEnv[Numbers, Numbers, Numbers]):
    """Many robots, simulated together; to the bit what as many of `Track` are, one by one.

    Robots whose episodes began in the same frame are one batch, which is what makes them fast.

    Args:
        num_envs: Number of robots.
        scenario: Its name, its file, or itself. What it draws from distributions is drawn for each
            episode.
        history_length: How many of the commands sent are observed. [as many as may be in flight, and one]
        max_error_m: How far off its reference a robot is lost, m.
        autoreset_mode: When an episode that has ended is followed by the next: with the next step
            (the action of which is ignored), or when `reset` says so. A robot whose episode has
            ended until then stays where it is and is rewarded with 0.
        changes: Of a scenario that is named: plant, robot, and sections of settings, as
            `om.load_scenario` takes them.

    Raises:
        OmniError: Something is unknown or not allowed.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Scenario | str = "rect",
        *,
        history_length: int | None = None,
        max_error_m: float = LOST_M,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
        **changes: Any,
    ) -> None:
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            raise OmniError("autoreset_mode must be NextStep or Disabled")
        if isinstance(scenario, Scenario) and changes:
            raise OmniError(
                f"{', '.join(changes)}: changes are made to a scenario that is named; make them in yours"
            )
        chosen = scenario if isinstance(scenario, Scenario) else load_scenario(scenario, **changes)
        if len(chosen.settings.world.start_poses) > 1:
            raise OmniError("world.start_poses: an environment is one robot; leave one place")
        self.history_length = _memory(chosen) if history_length is None else history_length
        if not 1 <= self.history_length <= LONGEST_MEMORY or not 0 < max_error_m < math.inf:
            raise OmniError(
                f"history_length must be from 1 to {LONGEST_MEMORY} frames, max_error_m above 0"
            )
        parameters = {ExternalController.__name__: {"history_length": self.history_length}}
        settings = Settings(**{**dict(chosen.settings), "controller": parameters})
        self.scenario = chosen.replace(controllers=(ExternalController,), settings=settings)
        self.num_envs, self.max_error_m = num_envs, max_error_m
        self.metadata = {**TrackEnv.metadata, "autoreset_mode": self.autoreset_mode}
        box, size = gymnasium.spaces.Box, observations.get_observation_size(self.history_length)
        self.single_observation_space = box(
            -observations.HIGHEST, observations.HIGHEST, (size,), np.float32
        )
        self.single_action_space = box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.seen = np.zeros((num_envs, size), np.float32)
        self.terminated, self.truncated = np.ones((2, num_envs), bool)
        self._batches: list[EpisodeBatch] = []
        self._random: list[np.random.Generator | None] = [None] * num_envs

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Numbers, dict[str, Any]]:
        """Begin an episode of each robot, or of those where `options["reset_mask"]`, (num_envs,), says so.

        Args:
            seed: Of the first; the others' count up from it. Or one for each.
            options: See above.

        Raises:
            OmniError: A seed draws what is not allowed.
        """
        if isinstance(seed, int):
            seed = [seed + i for i in range(self.num_envs)]
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, bool))
        info = self._begin(np.flatnonzero(mask), seed or [None] * self.num_envs)
        return self.seen.copy(), info

    def step(self, actions: Any) -> tuple[Numbers, Array, Bools, Bools, dict[str, Any]]:
        """Go on by a frame, 1/60 s; robots whose episodes have ended stay as they are.

        Raises:
            OmniError: The actions are not (num_envs, 3) finite numbers.
        """
        given = np.asarray(actions, float)
        if given.shape != (self.num_envs, 3):
            raise OmniError(
                f"actions must be finite numbers {(self.num_envs, 3)}, not of shape {given.shape}"
            )
        before = self.terminated | self.truncated
        reward, distance, turned = np.zeros((3, self.num_envs))
        self._batches = [batch for batch in self._batches if self._going(batch).any()]
        for batch in self._batches:
            going, simulation = self._going(batch), batch.simulation
            simulation.step(
                observations.decode_action(given[batch.robots], simulation.observe(), batch.limits)
            )
            poses = simulation.plant.pose()
            error = poses - batch.reference.at(simulation.frame, poses)[0]
            off, angle = np.hypot(error[:, 0], error[:, 1]), np.abs(wrap_angle(error[:, 2]))
            failed = np.isin(np.arange(len(off)), [failure.row for failure in simulation.failures])
            terminated = failed | ~(off <= self.max_error_m)  # what is no number has failed
            cost = np.minimum(
                np.where(failed, self.max_error_m, off + ARM_M * angle), self.max_error_m
            )
            cost += np.where(terminated, self.max_error_m * (batch.last - simulation.frame), 0.0)
            robots = batch.robots[going]
            reward[robots], distance[robots], turned[robots] = (
                -cost[going],
                off[going],
                angle[going],
            )
            self.terminated[robots] = terminated[going]
            self.truncated[robots] = ((simulation.frame >= batch.last) & ~terminated)[going]
            self._observe(batch, going)
        info: dict[str, Any] = {}
        if not before.all():
            info = {"distance_m": distance, "heading_error_rad": turned}
            info |= {f"_{name}": ~before for name in info}
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and before.any():
            info |= self._begin(np.flatnonzero(before), [None] * self.num_envs)
        return self.seen.copy(), reward, self.terminated.copy(), self.truncated.copy(), info

    def _begin(self, robots: NDArray[np.intp], seeds: Sequence[int | None]) -> dict[str, Any]:
        """Begin episodes of these robots from the start of their references; return their seeds."""
        numbers, begun = np.zeros(self.num_envs, np.int64), np.zeros(self.num_envs, bool)
        self.terminated[robots], self.truncated[robots], begun[robots] = False, False, True
        for batch in self._batches:  # what ended there is begun anew here
            batch.robots[np.isin(batch.robots, robots)] = -1
        groups: dict[object, dict[int, Row]] = {}
        for i in robots.tolist():
            random, seed = self._random[i], seeds[i]
            if seed is not None or random is None:
                self._random[i] = random = seeding.np_random(seed)[0]
            numbers[i] = seed = int(random.integers(LAST_SEED)) if seed is None else seed
            own = self.scenario.settings_of(seed)
            group = groups.setdefault(batch_key(self.scenario.plant, own), {})
            group[i] = Row(
                len(group), 0, ExternalController.__name__, seed, own, self.scenario.robot
            )
        for group in groups.values():
            simulation = Simulation(self.scenario, rows=list(group.values()), logged=False)
            self._batches.append(EpisodeBatch(simulation, np.array(list(group))))
            self._observe(self._batches[-1])
        return {"seed": numbers, "_seed": begun}

    def _going(self, batch: EpisodeBatch) -> Bools:
        return (batch.robots >= 0) & ~(self.terminated | self.truncated)[batch.robots]

    def _observe(self, batch: EpisodeBatch, going: Bools | slice = slice(None)) -> None:
        simulation = batch.simulation
        found = observations.encode_observation(
            simulation.frame, simulation.observe(), batch.reference, self.history_length
        )
        self.seen[batch.robots[going]] = found[going]


class TrackEnv(gymnasium.Env[Numbers, Numbers]):
    """A robot that is to follow the reference of a scenario: `Tracks` of one; see docs/how-to/train-a-policy.md.

    Args:
        scenario, given: As of `Tracks`.

    Raises:
        OmniError: Something is unknown or not allowed.
    """

    metadata = {"render_modes": [], "render_fps": round(FRAME_RATE_HZ)}  # noqa: RUF012 - as the base class has it

    def __init__(self, scenario: Scenario | str = "rect", **given: Any) -> None:
        self._one = TrackVectorEnv(1, scenario, autoreset_mode=AutoresetMode.DISABLED, **given)
        self.observation_space = self._one.single_observation_space
        self.action_space = self._one.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Begin an episode: with a seed, the run that `omni-mj run --seed` drives; without, the next that it draws."""
        super().reset(seed=seed)
        seen, info = self._one.reset(seed=seed)
        return seen[0], {"seed": int(info["seed"][0])}

    def step(self, action: Any) -> tuple[Numbers, float, bool, bool, dict[str, Any]]:
        """Go on by a frame, 1/60 s."""
        seen, reward, terminated, truncated, info = self._one.step(np.asarray(action, float)[None])
        model = {
            name: float(values[0]) for name, values in info.items() if not name.startswith("_")
        }
        return seen[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), model


def _memory(scenario: Scenario) -> int:
    """Return the frames within which a command has acted, at most.

    Raises:
        OmniError: There is no most, since the dead time is drawn from a distribution without ends.
    """
    control, radio = scenario.settings.control, scenario.settings.radio
    drawn = scenario.distributions.get("radio.delay_frames")
    if drawn is not None and not drawn.ends:
        raise OmniError(
            "radio.delay_frames is drawn from a distribution without ends: give it some, or give history_length="
        )
    longest = radio.delay_frames if drawn is None else max(drawn.ends)
    return int(longest) + radio.jitter_frames + math.ceil(control.assumed_lag_s / PERIOD_S) + 1

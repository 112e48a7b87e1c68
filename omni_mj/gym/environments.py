"""Gymnasium environments `omni_mj/Track-v0`: robots that follow the reference of a scenario."""

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omni_control.controllers.base import Controller
from omni_control.errors import OmniError
from omni_control.kinematics import Array, wrap_angle
from omni_control.reference import combine_references
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.config.settings import Settings
from omni_mj.gym import observations
from omni_mj.simulation.simulation import Simulation, batch_key

# The league's maximum. A heading error costs as much as the displacement at this radius, m/rad.
ROBOT_RADIUS_M = 0.09
MAX_ERROR_M = 1.0  # default position error at which an episode terminates
MAX_HISTORY_LENGTH = 600  # frames
MAX_SEED = 2**63 - 1
Numbers = NDArray[Any]
Bools = NDArray[np.bool_]


class ExternalController(Controller):
    """Placeholder for a controller whose commands come from outside; `command` is never called."""

    history_length: int = 1  # frames

    def __init__(self, model: object, reference: object, n: int) -> None:
        super().__init__(model, reference, n)  # type: ignore[arg-type]
        self.memory_frames = max(self.history_length, self.memory_frames)


class EpisodeBatch:
    """Robots whose episodes started in the same frame: the rows of one simulation.

    Args:
        simulation: Simulation of the n robots.
        env_indices: Environment of each row, (n,); -1 if it has since started another episode.

    Attributes:
        reference: Reference of all rows.
        last_frame: Last frame of each row's reference, (n,).
        limits: Limits of speed (x, y) and turn rate of each row, (n, 3), m/s and rad/s.
    """

    def __init__(self, simulation: Simulation, env_indices: NDArray[np.intp]) -> None:
        self.simulation, self.env_indices = simulation, env_indices
        references = simulation.references
        self.reference = combine_references(references)
        self.last_frame = np.array([reference.frames - 1 for reference in references])
        control = [row.settings.control for row in simulation.rows]
        self.limits = np.array(
            [[c.max_speed_m_s, c.max_speed_m_s, c.max_turn_rate_rad_s] for c in control]
        )


class TrackVectorEnv(VectorEnv[Numbers, Numbers, Numbers]):
    """Many robots, simulated together; the results equal those of single `TrackEnv`s bit for bit.

    Robots whose episodes start in the same frame run as one batch, which is faster.

    Args:
        num_envs: Number of robots.
        scenario: Name, file, or `Scenario`. Its distributions are drawn for each episode.
        history_length: Number of observed commands. Default: the maximum in flight plus one.
        max_error_m: Position error at which an episode terminates, m.
        autoreset_mode: When an ended episode is followed by the next one: in the next step, which
            ignores the action, or by `reset`. Until then a robot stays still with a reward of 0.
        render_mode: Must be None; the environments do not draw.
        changes: Changes of a named scenario: plant, robot, and sections of settings, as in
            `om.load_scenario`.

    Raises:
        OmniError: An argument is unknown or out of range.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Scenario | str = "rect",
        *,
        history_length: int | None = None,
        max_error_m: float = MAX_ERROR_M,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
        **changes: Any,
    ) -> None:
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            raise OmniError("autoreset_mode must be NextStep or Disabled, got SameStep")
        scenario = _load_single_robot_scenario(scenario, changes)
        if history_length is None:
            history_length = _compute_default_history_length(scenario)
        if not 1 <= history_length <= MAX_HISTORY_LENGTH:
            raise OmniError(
                f"history_length must be from 1 to {MAX_HISTORY_LENGTH} frames, "
                f"got {history_length}"
            )
        if not 0 < max_error_m < math.inf:
            raise OmniError(f"max_error_m must be above 0, got {max_error_m}")
        parameters = {ExternalController.__name__: {"history_length": history_length}}
        settings = Settings(**{**dict(scenario.settings), "controller": parameters})
        self.scenario = scenario.replace(controllers=(ExternalController,), settings=settings)
        self.num_envs, self.max_error_m = num_envs, max_error_m
        self.history_length = history_length
        self.metadata = {**TrackEnv.metadata, "autoreset_mode": self.autoreset_mode}
        size, high = observations.get_observation_size(history_length), observations.MAX_OBSERVATION
        self.single_observation_space = gymnasium.spaces.Box(-high, high, (size,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._observations = np.zeros((num_envs, size), np.float32)
        self._terminated, self._truncated = np.ones((2, num_envs), bool)
        self._batches: list[EpisodeBatch] = []
        self._generators = [np.random.default_rng() for _ in range(num_envs)]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Numbers, dict[str, Any]]:
        """Start an episode of each robot, or of those in `options["reset_mask"]`, (num_envs,).

        Args:
            seed: Seed of the first robot, counting up for the others; or one for each robot.
            options: Options of Gymnasium; only `reset_mask` is used.

        Raises:
            OmniError: A seed draws settings that are not allowed.
        """
        if isinstance(seed, int):
            seed = [seed + i for i in range(self.num_envs)]
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, bool))
        info = self._start_episodes(np.flatnonzero(mask), seed or [None] * self.num_envs)
        return self._observations.copy(), info

    def step(self, actions: Any) -> tuple[Numbers, Array, Bools, Bools, dict[str, Any]]:
        """Advance by a frame, 1/60 s; robots whose episodes have ended stay still.

        Raises:
            OmniError: The actions are not finite numbers (num_envs, 3).
        """
        actions = np.asarray(actions, float)
        if actions.shape != (self.num_envs, 3):
            raise OmniError(
                f"actions must be finite numbers {(self.num_envs, 3)}, got shape {actions.shape}"
            )
        had_ended = self._terminated | self._truncated
        results = np.zeros((5, self.num_envs))
        self._batches = [batch for batch in self._batches if self._is_running(batch).any()]
        for batch in self._batches:
            is_running, env_indices = self._is_running(batch), batch.env_indices
            batch_results = self._step_batch(batch, actions[env_indices])
            results[:, env_indices[is_running]] = batch_results[:, is_running]
            self._update_observations(batch, is_running)
        reward, position_error, heading_error = results[:3]
        self._terminated |= results[3] > 0
        self._truncated |= results[4] > 0
        info: dict[str, Any] = {}
        if not had_ended.all():
            info = {"position_error_m": position_error, "heading_error_rad": heading_error}
            info |= {f"_{name}": ~had_ended for name in info}
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and had_ended.any():
            info |= self._start_episodes(np.flatnonzero(had_ended), [None] * self.num_envs)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        return self._observations.copy(), reward, terminated, truncated, info

    def _step_batch(self, batch: EpisodeBatch, actions: Array) -> Array:
        """Advance a batch by a frame.

        Args:
            batch: Batch of n rows.
            actions: Actions of its rows, (n, 3).

        Returns:
            Reward, position error (m), heading error (rad), terminated and truncated, (5, n).
        """
        simulation = batch.simulation
        command = observations.decode_action(actions, simulation.observe(), batch.limits)
        simulation.step(command)
        poses = simulation.plant.pose()
        error = poses - batch.reference.at(simulation.frame, poses)[0]
        position_error = np.hypot(error[:, 0], error[:, 1])
        heading_error = np.abs(wrap_angle(error[:, 2]))
        has_failed = np.zeros(len(poses), bool)
        has_failed[[failure.row for failure in simulation.failures]] = True
        terminated = has_failed | ~(position_error <= self.max_error_m)  # also if it is NaN
        # A failed or terminated robot costs the maximum in all remaining frames.
        max_cost = self.max_error_m
        cost = np.where(has_failed, max_cost, position_error + ROBOT_RADIUS_M * heading_error)
        cost = np.minimum(cost, max_cost)
        remaining_frames = batch.last_frame - simulation.frame
        cost += np.where(terminated, max_cost * remaining_frames, 0.0)
        truncated = (simulation.frame >= batch.last_frame) & ~terminated
        return np.array([-cost, position_error, heading_error, terminated, truncated])

    def _start_episodes(
        self, env_indices: NDArray[np.intp], seeds: Sequence[int | None]
    ) -> dict[str, Any]:
        """Start episodes in these environments, and return the info with their seeds."""
        used_seeds, has_started = np.zeros(self.num_envs, np.int64), np.zeros(self.num_envs, bool)
        self._terminated[env_indices] = self._truncated[env_indices] = False
        has_started[env_indices] = True
        for batch in self._batches:
            batch.env_indices[np.isin(batch.env_indices, env_indices)] = -1
        groups: dict[object, dict[int, Row]] = {}
        for i in env_indices.tolist():
            seed = seeds[i]
            if seed is None:
                seed = int(self._generators[i].integers(MAX_SEED))
            else:
                self._generators[i] = np.random.default_rng(seed)
            used_seeds[i] = seed
            settings = self.scenario.settings_for_seed(seed)
            rows = groups.setdefault(batch_key(self.scenario.plant, settings), {})
            rows[i] = Row(
                len(rows), 0, ExternalController.__name__, seed, settings, self.scenario.robot
            )
        for rows in groups.values():
            simulation = Simulation(self.scenario, rows=list(rows.values()), keep_log=False)
            self._batches.append(EpisodeBatch(simulation, np.array(list(rows))))
            self._update_observations(self._batches[-1])
        return {"seed": used_seeds, "_seed": has_started}

    def _is_running(self, batch: EpisodeBatch) -> Bools:
        """Return the mask of the rows of a batch whose episodes have not ended."""
        return (batch.env_indices >= 0) & ~(self._terminated | self._truncated)[batch.env_indices]

    def _update_observations(self, batch: EpisodeBatch, rows: Bools | slice = slice(None)) -> None:
        """Write the observations of some rows of a batch."""
        simulation = batch.simulation
        batch_observations = observations.encode_observation(
            simulation.frame, simulation.observe(), batch.reference, self.history_length
        )
        self._observations[batch.env_indices[rows]] = batch_observations[rows]


class TrackEnv(gymnasium.Env[Numbers, Numbers]):
    """A robot that follows the reference of a scenario; see docs/how-to/train-a-policy.md.

    Args:
        scenario, options: Same as for `TrackVectorEnv`.

    Raises:
        OmniError: An argument is unknown or out of range.
    """

    # Gymnasium's base class also has a mutable class attribute.
    metadata = {"render_modes": [], "render_fps": round(FRAME_RATE_HZ)}  # noqa: RUF012

    def __init__(self, scenario: Scenario | str = "rect", **options: Any) -> None:
        self._env = TrackVectorEnv(1, scenario, autoreset_mode=AutoresetMode.DISABLED, **options)
        self.observation_space = self._env.single_observation_space
        self.action_space = self._env.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Start an episode.

        With a seed, it has the noise of `omni-mj run --seed`; without, that of the next seed drawn.
        """
        super().reset(seed=seed)
        observation, info = self._env.reset(seed=seed)
        return observation[0], {"seed": int(info["seed"][0])}

    def step(self, action: Any) -> tuple[Numbers, float, bool, bool, dict[str, Any]]:
        """Advance by a frame, 1/60 s."""
        observation, reward, terminated, truncated, info = self._env.step(
            np.asarray(action, float)[None]
        )
        info = {name: float(values[0]) for name, values in info.items() if not name.startswith("_")}
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info


def _load_single_robot_scenario(scenario: Scenario | str, changes: dict[str, Any]) -> Scenario:
    """Return a scenario by name with changes, or a `Scenario` object as it is.

    Raises:
        OmniError: A `Scenario` object is to be changed, or a world has several robots.
    """
    if isinstance(scenario, Scenario) and changes:
        raise OmniError(
            f"{', '.join(changes)}: only a scenario given by name can be changed here; change the "
            "Scenario object with its method replace"
        )
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario, **changes)
    if len(loaded.settings.world.start_poses) > 1:
        raise OmniError("world.start_poses must have one pose: an environment has one robot")
    return loaded


def _compute_default_history_length(scenario: Scenario) -> int:
    """Return the largest number of frames from a command to the end of its effect.

    Raises:
        OmniError: The dead time is drawn from an unbounded distribution.
    """
    control, radio = scenario.settings.control, scenario.settings.radio
    distribution = scenario.distributions.get("radio.delay_frames")
    if distribution is not None and not distribution.bounds:
        raise OmniError(
            "radio.delay_frames is drawn from an unbounded distribution: bound it, or give "
            "history_length="
        )
    max_delay = radio.delay_frames if distribution is None else max(distribution.bounds)
    radio_frames = math.ceil(max_delay + radio.jitter_frames + radio.max_air_frames)
    return radio_frames + math.ceil(control.assumed_lag_s / PERIOD_S) + 1

"""Gymnasium environments `omni_mj/Track-v0`: robots that follow the reference of a scenario."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import starmap
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omni_control.arguments import check_array, check_integer, fits_annotation
from omni_control.controllers.base import Controller, TeamModel
from omni_control.errors import OmniError, format_value
from omni_control.kinematics import Array, compute_pose_error
from omni_control.reference import Reference, combine_references
from omni_mj.config import FRAME_RATE_HZ, PERIOD_S
from omni_mj.config.rows import Row
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.config.settings import Settings
from omni_mj.gym import observations
from omni_mj.mjcf.field import ROBOT_RADIUS_M
from omni_mj.simulation.simulation import Simulation, batch_key
from omni_mj.viz.route_picture import draw_robot

MAX_ENVS = 1_000_000
MAX_ERROR_M = 1.0  # default position error at which an episode terminates
MAX_HISTORY_LENGTH = 600  # frames
MAX_SEED = 2**63 - 1 - MAX_ENVS
Numbers = NDArray[Any]
Bools = NDArray[np.bool_]


class ExternalController(Controller):
    """Placeholder for a controller whose commands come from outside; `command` is never called."""

    history_length: int = 1  # frames

    def __init__(self, model: TeamModel, reference: Reference, n: int) -> None:
        super().__init__(model, reference, n)
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
        render_mode: "rgb_array" for pictures from `render`, or None.
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
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        if isinstance(autoreset_mode, str):
            with suppress(ValueError):
                autoreset_mode = AutoresetMode(autoreset_mode)
        is_mode = isinstance(autoreset_mode, AutoresetMode)
        if not is_mode or autoreset_mode is AutoresetMode.SAME_STEP:
            raise OmniError(
                f"autoreset_mode must be NextStep or Disabled, got {format_value(autoreset_mode)}"
            )
        if not fits_annotation(render_mode, Literal["rgb_array"] | None):
            raise OmniError(
                f"render_mode must be 'rgb_array' or None, got {format_value(render_mode)}"
            )
        self.autoreset_mode, self.render_mode = autoreset_mode, render_mode
        num_envs = check_integer("num_envs", num_envs, 1, MAX_ENVS)
        loaded = _load_single_robot_scenario(scenario, changes)
        if history_length is None:
            history_length = _compute_default_history_length(loaded)
        history_length = check_integer("history_length", history_length, 1, MAX_HISTORY_LENGTH)
        if not fits_annotation(max_error_m, float) or not 0 < max_error_m < math.inf:
            raise OmniError(f"max_error_m must be a number above 0, got {max_error_m!r}")
        parameters = {ExternalController.__name__: {"history_length": history_length}}
        settings = Settings(**{**dict(loaded.settings), "controller": parameters})
        self.scenario = loaded.replace(controllers=(ExternalController,), settings=settings)
        self.num_envs, self.max_error_m = num_envs, max_error_m
        self.history_length = history_length
        self.metadata = TrackEnv.metadata | {"autoreset_mode": self.autoreset_mode}
        size, high = observations.get_observation_size(history_length), observations.MAX_OBSERVATION
        self.single_observation_space = gymnasium.spaces.Box(-high, high, (size,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._observations = np.zeros((num_envs, size), np.float32)
        self._terminated, self._truncated = np.ones((2, num_envs), bool)
        self._has_started = False
        # Arguments of `draw_robot` for each robot, if pictures are drawn
        self._scenes: list[tuple[Array, Array, int]] = [(np.zeros(3), np.zeros((1, 3)), 0)]
        self._scenes *= num_envs
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
            OmniError: A seed or the mask is invalid, or a seed draws settings that are not allowed.
        """
        seeds = self._list_seeds(seed)
        mask = np.ones(self.num_envs, bool)
        if options is not None:
            if not isinstance(options, Mapping):
                raise OmniError(f"options must be a dictionary, got {format_value(options)}")
            mask = np.asarray(options.get("reset_mask", mask))
        if mask.shape != (self.num_envs,) or mask.dtype != bool:
            raise OmniError(
                f"reset_mask must be {self.num_envs} booleans, got {format_value(mask)}"
            )
        info = self._start_episodes(np.flatnonzero(mask), seeds)
        return self._observations.copy(), info

    def step(self, actions: Any) -> tuple[Numbers, Array, Bools, Bools, dict[str, Any]]:
        """Advance by a frame, 1/60 s; robots whose episodes have ended stay still.

        Raises:
            OmniError: The actions are not finite numbers (num_envs, 3).
            ResetNeeded: There was no `reset`.
        """
        actions = check_array("actions", actions, (self.num_envs, 3))
        if not self._has_started:
            raise ResetNeeded("call reset() before step()")
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

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each robot, or None if the render mode is None.

        Raises:
            ResetNeeded: There was no `reset`.
        """
        if self.render_mode is None:
            gymnasium.logger.warn('no picture: make the environment with render_mode="rgb_array"')
            return None
        if not self._has_started:
            raise ResetNeeded("call reset() before render()")
        return tuple(starmap(draw_robot, self._scenes))

    def _list_seeds(self, seed: Any) -> list[int | None]:
        """Return the seed of each robot, from one for the first robot or one for each.

        Raises:
            OmniError: A seed is not an integer in the allowed range, or their number is wrong.
        """
        n = self.num_envs
        if seed is None:
            return [None] * n
        is_list = isinstance(seed, (Sequence, np.ndarray)) and not isinstance(seed, str | bytes)
        if not is_list or np.ndim(seed) == 0:
            start = check_integer("seed", seed, 0, MAX_SEED)
            return list(range(start, start + n))
        if len(seed) != n:
            raise OmniError(f"seed must be an integer or {n} of them, got {format_value(seed)}")
        return [None if s is None else check_integer("seed", s, 0, MAX_SEED) for s in seed]

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
        error = compute_pose_error(poses, batch.reference.at(simulation.frame, poses)[0])
        position_error = np.hypot(error[:, 0], error[:, 1])
        heading_error = np.abs(error[:, 2])
        has_failed = np.zeros(len(poses), bool)
        has_failed[[failure.row for failure in simulation.failures]] = True
        terminated = has_failed | ~(position_error <= self.max_error_m)  # also if it is NaN
        # No reward is negative, so a robot that ends early forgoes those of the remaining frames.
        cost = np.minimum(position_error + ROBOT_RADIUS_M * heading_error, self.max_error_m)
        reward = np.where(terminated, 0.0, self.max_error_m - cost)
        truncated = (simulation.frame >= batch.last_frame) & ~terminated
        return np.array([reward, position_error, heading_error, terminated, truncated])

    def _start_episodes(
        self, env_indices: NDArray[np.intp], seeds: Sequence[int | None]
    ) -> dict[str, Any]:
        """Start episodes in these environments, and return the info with their seeds."""
        self._has_started = True
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
        if self.render_mode:
            poses = simulation.plant.pose()
            for row in np.arange(len(poses))[rows]:
                scene = poses[row], simulation.references[row].poses, simulation.frame
                self._scenes[batch.env_indices[row]] = scene


class TrackEnv(gymnasium.Env[Numbers, Numbers]):
    """A robot that follows the reference of a scenario; see docs/how-to/train-a-policy.md.

    Args:
        scenario, options: Same as for `TrackVectorEnv`.

    Raises:
        OmniError: An argument is unknown or out of range.
    """

    # Gymnasium's base class also has a mutable class attribute.
    metadata = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": round(FRAME_RATE_HZ),
    }

    def __init__(self, scenario: Scenario | str = "rect", **options: Any) -> None:
        for name in {"num_envs", "autoreset_mode"} & options.keys():
            raise OmniError(f"{name} is an argument of gymnasium.make_vec only")
        self._env = TrackVectorEnv(1, scenario, autoreset_mode=AutoresetMode.DISABLED, **options)
        self.observation_space = self._env.single_observation_space
        self.action_space = self._env.single_action_space
        self.render_mode = self._env.render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Start an episode.

        With a seed, it has the noise of `omni-mj run --seed`; without, that of the next seed drawn.
        """
        if seed is not None:
            seed = check_integer("seed", seed, 0, MAX_SEED)
        super().reset(seed=seed)
        observation, info = self._env.reset(seed=seed)
        return observation[0], {"seed": int(info["seed"][0])}

    def step(self, action: Any) -> tuple[Numbers, float, bool, bool, dict[str, Any]]:
        """Advance by a frame, 1/60 s."""
        observation, reward, terminated, truncated, info = self._env.step(
            check_array("action", action, (3,))[None]
        )
        info = {name: float(values[0]) for name, values in info.items() if not name.startswith("_")}
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture seen from above, or None if the render mode is None."""
        pictures = self._env.render()
        return pictures[0] if pictures else None


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

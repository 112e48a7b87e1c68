"""The plant `planar`: robots in the plane, on wheels that creep and slide.

The equations are in `omni_mj.robot.planar_dynamics` and docs/explanation/planar-plant.md.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from omni_control.kinematics import Array
from omni_mj.config.faults import Payload
from omni_mj.config.rows import Row
from omni_mj.mjcf import world_builder
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.fault_effects import BLOCKED_HUB_NM, ChangeableBodies
from omni_mj.plants.planar_body_parameters import PlanarBodyBuilder
from omni_mj.plants.randomization import RobotVariation
from omni_mj.plants.row_checks import check_planar_rows
from omni_mj.plants.telemetry import Telemetry
from omni_mj.plants.wheeled_plant_base import WheeledPlantBase
from omni_mj.robot.array_ops import rotate, select
from omni_mj.robot.electronics import ElectronicsParameters, stack_telemetry
from omni_mj.robot.firmware_state import FirmwareCommand
from omni_mj.robot.numpy_and_jax_backends import JaxBackend, NumpyBackend
from omni_mj.robot.planar_dynamics import BodyParameters, BodyState, compute_point_velocity
from omni_mj.robot.planar_robot import (
    FrameReport,
    PlanarParameters,
    PlanarState,
    advance_frame,
)

# Causes of failures, as `advance` returns them
UNSTABLE = "became unstable: its pose is not a number"
WOULD_TOPPLE = "would topple over, which the plant planar does not simulate"


class PlanarPlant(WheeledPlantBase, ChangeableBodies):
    """Robots with roller wheels on carpet, each alone in its world, without a contact solver.

    Args:
        rows: Rows of the robots; all must have the same wheels.
        start_poses: Poses at the start, world frame, (n, 3) m, m, rad.

    Raises:
        OmniError: Robots share a world or differ in their wheels, a model is a custom one, or a
            robot is lighter than its wheels.

    Attributes:
        ignores_contact: Whether robots may share a world, in which they pass through each other.
    """

    ignores_contact = False

    def __init__(self, rows: Sequence[Row], start_poses: Array) -> None:
        check_planar_rows(rows, self.ignores_contact)
        settings = [row.settings for row in rows]
        world = world_builder.build_world(settings[0])
        n = len(rows)
        self._pose = np.array(start_poses, float)
        variation = RobotVariation.draw(rows)
        super().__init__(rows, world.kinematics, variation, self._pose[:, 2])
        self._body_builder = PlanarBodyBuilder(settings, variation, world)
        self._payloads: list[tuple[int, Payload]] = []
        self._slope = np.zeros((n, 2))
        body = self._body_builder.build(self._payloads, self._slope)
        self._hub_is_blocked = np.zeros(body.hub_dry_friction.shape, bool)
        electronics, electronics_state = self._initial_electronics
        parameters = PlanarParameters(electronics, self._nominal_carpet, body)
        state = PlanarState(electronics_state, make_body_at_rest(body, self._pose))
        self._backend: JaxBackend | NumpyBackend = (
            JaxBackend if settings[0].physics.backend == "jax" else NumpyBackend
        )(parameters, state)
        self._start_faults(self)
        self._twist = np.zeros((n, 3))
        zeros = np.zeros(self._hub_is_blocked.shape)
        self._telemetry = Telemetry(
            stack_telemetry(electronics_state, self._record, zeros, zeros, zeros).T
        )

    @property
    def parameters(self) -> Any:
        """Parameters of the robots."""
        return self._backend.parameters

    @parameters.setter
    def parameters(self, parameters: Any) -> None:
        self._backend.parameters = parameters

    @property
    def state(self) -> Any:
        """State of the robots."""
        return self._backend.state

    @property
    def electronics(self) -> Any:
        """State of firmware, motors and battery."""
        return self.state.electronics

    @electronics.setter
    def electronics(self, electronics: Any) -> None:
        self._backend.state = self.state._replace(electronics=electronics)

    def pose(self) -> Array:
        """See `Plant`."""
        return self._pose

    def twist(self) -> Array:
        """See `Plant`."""
        return self._twist

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        return self._telemetry

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """See `Plant`."""
        inputs = self._make_inputs(received.heading, received.age)
        _, initial = next(received.split())
        later_commands = self._make_later_commands(received) if received.segments else None
        return self._finish_frame(
            self._backend.run(advance_frame, self._make_command(initial), inputs, later_commands)
        )

    def set_payloads(self, payloads: Iterable[tuple[int, Payload]]) -> None:
        """See `ChangeableBodies`. The centers of the wheels keep their poses and velocities."""
        self._payloads = list(payloads)
        old = self.parameters.body
        new = self._rebuild_bodies()
        # Displacement of the center of mass, body frame, m
        shift = old.center - new.center
        state = self.state
        body = state.body
        world_x, world_y = rotate(shift, body.cosine, body.sine)
        twist = np.stack([*compute_point_velocity(body.twist, shift), body.twist[2]])
        body = body._replace(x=body.x + world_x, y=body.y + world_y, twist=twist)
        self._backend.state = state._replace(body=body)

    def set_slope(self, slope: Array) -> None:
        """See `ChangeableBodies`."""
        self._slope = slope
        self._rebuild_bodies()

    def block_hubs(self, is_blocked: np.ndarray) -> None:
        """See `ChangeableBodies`."""
        self._hub_is_blocked = is_blocked
        self._rebuild_bodies()

    def displace_robot(self, row: int, displacement: tuple[float, float, float]) -> None:
        """See `ChangeableBodies`."""
        pose = self._pose.copy()
        pose[row] += displacement
        self._stop_robots(np.arange(len(pose)) == row, pose)

    def _make_later_commands(self, received: ReceivedCommand) -> FirmwareCommand:
        """Return the commands that arrive after the first cycle, with a leading axis of cycles."""
        commands = []
        for n_cycles, segment in received.split():
            command = self._make_command(segment)
            is_old = np.zeros_like(command.is_new)
            commands += [command, *(n_cycles - 1) * [command._replace(is_new=is_old)]]
        velocity, is_new = (np.array(values) for values in list(zip(*commands, strict=True))[:2])
        is_new[0] = False
        return FirmwareCommand(velocity, is_new)

    def _change_parameters(self, electronics: ElectronicsParameters) -> ChangeableBodies:
        settings = [row.settings for row in self._rows]
        world = world_builder.build_world(settings[0])
        self._body_builder = PlanarBodyBuilder(settings, self.variation, world)
        body = self.parameters.body
        self.parameters = PlanarParameters(electronics, self._nominal_carpet, body)
        self._rebuild_bodies()
        return self

    def _rebuild_bodies(self) -> BodyParameters:
        """Set and return the bodies' parameters for present payloads, slopes and blocked hubs."""
        body = self._body_builder.build(self._payloads, self._slope)
        dry_friction = np.where(self._hub_is_blocked, BLOCKED_HUB_NM, body.hub_dry_friction)
        body = body._replace(hub_dry_friction=dry_friction)
        self.parameters = self.parameters._replace(body=body)
        return body

    def _finish_frame(self, report: FrameReport) -> dict[int, str]:
        """Store motion and telemetry, stop robots that fail, and return their causes by row."""
        previous_pose = self._pose
        self._telemetry = Telemetry(report.telemetry.T)
        self._pose = report.pose.T
        self._twist = report.twist.T
        is_unstable = ~np.isfinite(self._pose.sum(1))
        has_failed = self._failed | is_unstable | report.topples
        if not has_failed.any():
            return {}
        failures = {
            row: UNSTABLE if is_unstable[row] else WOULD_TOPPLE
            for row in np.flatnonzero(has_failed & ~self._failed).tolist()
        }
        self._failed = has_failed
        self._stop_robots(has_failed, previous_pose)
        return failures

    def _stop_robots(self, mask: np.ndarray, pose: Array) -> None:
        """Bring some robots to rest.

        Args:
            mask: Robots to stop, (n,).
            pose: Poses for these robots; other rows are not used, (n, 3) m, m, rad.
        """
        state = self.state
        body = make_body_at_rest(self.parameters.body, pose)
        body = body._replace(hub_angle=state.body.hub_angle, encoder_angle=state.body.encoder_angle)
        body = BodyState(*(np.where(np.isfinite(values), values, 0.0) for values in body))
        self._backend.state = state._replace(body=select(mask, body, state.body))
        self._pose = np.where(mask[:, None], pose, self._pose)
        self._twist = np.where(mask[:, None], 0.0, self._twist)


def make_body_at_rest(p: BodyParameters, pose: Array) -> BodyState:
    """Return bodies at rest.

    Args:
        p: Parameters.
        pose: Poses of the centers of the wheels, world frame, (n, 3) m, m, rad.
    """
    x, y, heading = np.array(pose.T)
    cosine = np.cos(heading)
    sine = np.sin(heading)
    zeros = np.zeros_like(x)
    wheel_zeros = np.zeros_like(p.static_load)
    center_x, center_y = rotate(p.center, cosine, sine)
    return BodyState(
        x=x - center_x,
        y=y - center_y,
        heading=heading,
        cosine=cosine,
        sine=sine,
        twist=np.zeros((3, len(x))),
        gyro_rate=zeros,
        hub_angle=wheel_zeros,
        encoder_angle=wheel_zeros,
        hub_speed=wheel_zeros,
        rim_speed=wheel_zeros,
        torque=wheel_zeros,
        load=p.static_load,
        passed_rollers=wheel_zeros,
        tilting_moment=np.zeros((2, len(x))),
    )

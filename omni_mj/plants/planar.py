"""The planar plant: robots in the plane, on wheels that creep and slide, driven by their firmware (docs/explanation/planar-plant.md)."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.config.rows import Row
from omni_mj.mjcf import world_builder
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants import Telemetry
from omni_mj.plants.domain_randomization import Drawn
from omni_mj.plants.fault_effects import STUCK_NM, Faulty
from omni_mj.plants.planar_parameters import PlanarBodies
from omni_mj.plants.wheeled_plant import WheeledPlant, by_wheel
from omni_mj.robot.array_namespace import rotate, select
from omni_mj.robot.backends import JaxBackend, NumpyBackend
from omni_mj.robot.carpet import carpet_parameters
from omni_mj.robot.planar_body import (
    BodyParameters,
    BodyState,
    FrameReport,
    PlanarParameters,
    PlanarState,
    advance_frame,
)


class PlanarPlant(WheeledPlant, Faulty):
    """Robots with roller wheels on carpet, each alone in its world, without a contact solver.

    Args:
        rows: Of the robots; all must have the same wheels.
        start: Poses at the start, (n, 3).

    Raises:
        OmniError: Rows that this plant cannot hold: robots that share a world, or differ in their
            wheels, a model of a user's own, or a robot lighter than its wheels.
    """

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        _check(rows)
        settings = [row.settings for row in rows]
        world = world_builder.build_world(settings[0])
        x, y, heading = np.array(start, float).T
        drawn = Drawn.of(rows)
        super().__init__(rows, world.kinematics, drawn, heading)
        self._bodies = PlanarBodies(settings, drawn, world)
        self._loads: list[tuple[int, float, float]] = []
        self._slope = np.zeros((len(rows), 2))
        body, (onboard, onboard_state) = (
            self._bodies.parameters(self._loads, self._slope),
            self._onboard,
        )
        carpet = carpet_parameters(
            settings, world.kinematics, by_wheel(drawn.friction), by_wheel(drawn.wear)
        )
        self._stuck = np.zeros(body.hub_dry.shape, bool)  # hubs
        state = PlanarState(onboard_state, body_at_rest(body, x, y, heading))
        parameters = PlanarParameters(onboard, carpet, body)
        backend = JaxBackend if settings[0].physics.backend == "jax" else NumpyBackend
        self._backend: JaxBackend | NumpyBackend = backend(parameters, state)
        self._start_faults(self)
        self._stopped = np.zeros(len(rows), bool)
        self._pose, self._twist = np.array(start, float), np.zeros((len(rows), 3))
        self._report: FrameReport | None = None

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
    def onboard(self) -> Any:
        """State of what robots carry."""
        return self._backend.state.onboard

    def pose(self) -> Array:
        """See `Plant`."""
        return self._pose

    def twist(self) -> Array:
        """See `Plant`."""
        return self._twist

    def advance(self, received: ReceivedCommand) -> dict[int, str]:
        """See `Plant`."""
        inputs = self._inputs(received.heading, received.age, self._stopped)
        report = self._backend.run(advance_frame, self._command(received), inputs)
        before, self._report = self._pose, report
        self._pose, self._twist = report.pose.T, report.twist.T
        broken = ~np.isfinite(self._pose.sum(1))
        if not (broken.any() or report.topples.any() or self._stopped.any()):
            return {}
        causes = {
            int(row): "would topple over, which the plant planar does not follow"
            for row in np.flatnonzero(report.topples & ~self._stopped)
        }
        causes |= {
            int(row): "became unstable: its pose is not a number"
            for row in np.flatnonzero(broken & ~self._stopped)
        }
        self._stopped = self._stopped | broken | report.topples
        self._rest(self._stopped, before)
        return causes

    def telemetry(self) -> Telemetry:
        """See `Plant`."""
        if self._report is None:
            zero = np.zeros(self._stuck.shape)
            return self._telemetry(self.onboard, zero, zero, zero)
        return Telemetry(self._report.telemetry.T)

    def carry(self, loads: Iterable[tuple[int, float, float]]) -> None:
        """See `omni_mj.plants.fault_effects.Faulty`. The middles of the robots stay where they are."""
        self._loads = list(loads)
        before, after = self.parameters.body, self._rebuild()
        x, y = before.middle_x - after.middle_x, before.middle_y - after.middle_y
        state: Any = self._backend.state
        body, (ahead, aside, rate) = state.body, state.body.twist
        world_x, world_y = rotate(x, y, body.cosine, body.sine)
        twist = np.stack([ahead - rate * y, aside + rate * x, rate])
        self._backend.state = state._replace(
            body=body._replace(x=body.x + world_x, y=body.y + world_y, twist=twist)
        )

    def lean(self, along: Array) -> None:
        """See `omni_mj.plants.fault_effects.Faulty`."""
        self._slope = along
        self._rebuild()

    def block(self, stuck: np.ndarray) -> None:
        """See `omni_mj.plants.fault_effects.Faulty`."""
        self._stuck = stuck
        self._rebuild()

    def put(self, robot: int, moved: tuple[float, float, float]) -> None:
        """See `omni_mj.plants.fault_effects.Faulty`."""
        pose = self._pose.copy()
        pose[robot] += moved
        self._rest(np.arange(len(pose)) == robot, pose)

    def _rebuild(self) -> BodyParameters:
        """Set the bodies' parameters anew."""
        body = self._bodies.parameters(self._loads, self._slope)
        body = body._replace(hub_dry=np.where(self._stuck, STUCK_NM, body.hub_dry))
        self.parameters = self.parameters._replace(body=body)
        return body

    def _rest(self, robots: np.ndarray, pose: Array) -> None:
        """Put some robots (n,) to rest at their poses, as rows of (n, 3)."""
        state: Any = self._backend.state
        still = body_at_rest(self.parameters.body, *pose.T)
        still = still._replace(
            hub_angle=state.body.hub_angle, encoder_angle=state.body.encoder_angle
        )
        still = BodyState(*(np.where(np.isfinite(value), value, 0.0) for value in still))
        self._backend.state = state._replace(body=select(robots, still, state.body))
        self._pose = np.where(robots[:, None], pose, self._pose)
        self._twist = np.where(robots[:, None], 0.0, self._twist)


def body_at_rest(p: BodyParameters, x: Array, y: Array, heading: Array) -> BodyState:
    """Return bodies at rest, the middles of their wheels at x and y (n,) m with a heading (n,) in rad."""
    cosine, sine, still, wheels = (
        np.cos(heading),
        np.sin(heading),
        np.zeros_like(x),
        np.zeros_like(p.weight),
    )
    middle_x, middle_y = rotate(p.middle_x, p.middle_y, cosine, sine)
    return BodyState(
        x=x - middle_x,
        y=y - middle_y,
        heading=np.array(heading),
        cosine=cosine,
        sine=sine,
        twist=np.zeros((3, len(x))),
        gyro_rate=still,
        hub_angle=wheels,
        encoder_angle=wheels,
        hub_speed=wheels,
        rim_speed=wheels,
        torque=wheels,
        load=p.weight,
        rollers=wheels,
        tilt=np.zeros((2, len(x))),
    )


def _check(rows: Sequence[Row]) -> None:
    """Refuse what this plant cannot do."""
    for number, row in enumerate(rows):
        settings = row.settings
        if row.slot:
            raise OmniError(
                "the plant planar has one robot in a world, since nothing collides in it; take the plant mujoco"
            )
        if settings.model.file:
            raise OmniError(
                "the plant planar knows no models of a user's own (model.file); take the plant mujoco"
            )
        if settings.wheels != rows[0].settings.wheels:
            raise OmniError(
                f"rows 0 and {number} differ in wheels, which must be alike in a batch of the plant planar"
            )

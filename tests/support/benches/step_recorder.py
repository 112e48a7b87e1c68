"""Recorder of every physics step of a plant, for tests of contacts."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benches.plant import CONTACTS
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants.mujoco_plant import MujocoPlant


class StepRecorder:
    """Recorder between a plant with one robot per world and its batch.

    Attributes:
        steps: after each step, by name: `position` (n, 3), `quaternion` (n, 4), `velocity` (n, 6)
            of the free joint, `wheels` and `slips`, speeds of hubs and of rims on them (n, W)
            rad/s, `load` (n, W) N in the step.
        currents: of each cycle, (n, W) A.
    """

    def __init__(self, plant: MujocoPlant) -> None:
        self._batch, self._plant = plant._batch, plant
        self.steps: dict[str, Any] = {}
        self.currents: Any = []
        plant._batch = self  # type: ignore[assignment]

    def step(self, worlds: NDArray | None) -> None:
        self._batch.step(worlds)
        plant = self._plant
        for name, columns in (
            ("pose", plant._views.pose),
            ("velocity", plant._views.velocity),
            ("wheels", plant._views.wheel_speed),
            ("slips", plant._views.slip_speed),
            ("load", plant._views.load),
        ):
            self.steps.setdefault(name, []).append(columns.get().T)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)

    def drive(self, commands: ArrayLike) -> "StepRecorder":
        """Drive with commands (frames, n, 3) and the true heading; no robot may fail."""
        plant = self._plant
        for command in np.asarray(commands, float):
            assert (
                plant.advance(
                    ReceivedCommand(command, plant.pose()[:, 2], np.zeros(len(command), int))
                )
                == {}
            )
            self.currents.append(plant._record.current.swapaxes(1, 2))
        self.steps = {name: np.array(values) for name, values in self.steps.items()}
        self.steps["position"], self.steps["quaternion"] = np.split(
            self.steps["pose"], [3], axis=-1
        )
        self.currents = np.concatenate(self.currents)
        return self

    def hub_torque(self) -> NDArray:
        """Return the torque on hubs and rotors, (steps, n, W) N m: of the motors, less losses."""
        plant, hubs = self._plant, self._plant._world.robots[0].wheel_dofs
        gear = plant._world.model.actuator_gear[plant._world.robots[0].motors, 0]
        friction, damping = (
            self._batch.expand(name)[:, hubs] for name in ("dof_frictionloss", "dof_damping")
        )
        wheels = self.steps["wheels"]
        currents = np.repeat(self.currents, len(wheels) // len(self.currents), axis=0)
        return np.asarray(
            plant._views.torque_constant.get().T * gear * currents
            - friction * np.sign(wheels)
            - damping * wheels
        )

    def heading(self) -> NDArray:
        """Return the headings (steps, n) of upright robots."""
        q = self.steps["quaternion"]
        return np.unwrap(2 * np.arctan2(q[..., 3], q[..., 0]), axis=0)

    def twist(self) -> NDArray:
        """Return the twists in the body frame, (steps, n, 3)."""
        v, c, s = self.steps["velocity"], np.cos(self.heading()), np.sin(self.heading())
        return np.stack(
            [c * v[..., 0] + s * v[..., 1], c * v[..., 1] - s * v[..., 0], v[..., 5]], axis=-1
        )

    def contact_velocity(self) -> NDArray:
        """Return the velocities of the wheels' centers in the body frame, (steps, n, W, 2)."""
        twist = self.twist()
        turning = twist[..., 2, None, None] * np.stack([-CONTACTS[:, 1], CONTACTS[:, 0]], axis=1)
        return np.asarray(twist[..., None, :2] + turning)

    def lift(self) -> NDArray:
        """Return the height of each wheel above its start, (steps, n, W) m."""
        w, x, y, z = np.moveaxis(self.steps["quaternion"], -1, 0)
        # Heights per distance along the robot's axes.
        axes = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x)], axis=-1)
        slope = axes @ CONTACTS.T
        height = self.steps["position"][..., 2, None] + slope
        return np.asarray(height - height[0])

    def tilt(self) -> NDArray:
        """Return the angle between the robot's axis and the vertical, (steps, n) rad."""
        q = self.steps["quaternion"]
        return np.asarray(2 * np.arcsin(np.hypot(q[..., 1], q[..., 2])))

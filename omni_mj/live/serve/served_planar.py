"""Plant `planar` of `serve`: robots that can be placed and removed, without collisions."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, world_to_body
from omni_mj.config.rows import Row
from omni_mj.live.serve.served_plant import HEADING_MEMORY_FRAMES
from omni_mj.plants.cyclewise_plant import CyclewisePlant
from omni_mj.plants.planar_plant import PlanarPlant
from omni_mj.robot.array_ops import rotate
from omni_mj.robot.electronics import CycleRecord
from omni_mj.robot.planar_dynamics import (
    SlowForces,
    compute_center_motion,
    compute_point_velocity,
)
from omni_mj.robot.planar_robot import (
    advance_cycle,
    begin_planar_frame,
    compute_slow_forces,
    make_report,
)
from omni_mj.robot.wheel_carpet_forces import DRAG_CYCLES


class ServedPlanar(CyclewisePlant, PlanarPlant):
    """Robots that pass through each other and through walls, and can be removed.

    Args:
        rows: Rows of the robots, in the order of their slots.
        start: Initial poses, shape (n, 3), m and rad.

    Attributes:
        present: Which robots are on the field, shape (n,).
        is_unstable: Whether physics has failed: never, because robots fail one by one.
    """

    min_heading_memory = HEADING_MEMORY_FRAMES
    ignores_contact = True
    is_unstable = False
    _slow: SlowForces

    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        super().__init__(rows, start)
        self.present = np.ones(len(rows), bool)
        self._start_cycles()

    def pose(self) -> Array:
        """Return poses, also between frames, shape (n, 3)."""
        motion = compute_center_motion(self.parameters.body, self.state.body)
        return np.column_stack([motion.x, motion.y, self.state.body.heading])

    def twist(self) -> Array:
        """Return twists, also between frames, shape (n, 3)."""
        motion = compute_center_motion(self.parameters.body, self.state.body)
        velocity = rotate(motion.velocity, motion.cosine, motion.sine)
        return np.column_stack([*velocity, motion.turn_rate])

    def place_robot(self, robot: int, pose: Array, twist: Array) -> None:
        """Place a robot, with wheels that roll without slip.

        Args:
            robot: Index of the robot.
            pose: Pose, shape (3,), m and rad.
            twist: Twist in the world frame, shape (3,), m/s and rad/s.
        """
        self.present[robot], self._failed[robot] = True, False
        mask = np.arange(len(self._rows)) == robot
        poses = np.where(mask[:, None], pose, self.pose())
        self._stop_robots(mask, poses)
        state = self.state
        body_twist = world_to_body(twist, pose[2])
        assert self.geometry is not None
        wheel_speed = self.geometry.wheel_speeds(body_twist)[:, None]
        body = state.body
        # Of the center of mass, from that of the center of the wheels
        from_wheels = -self.parameters.body.center[:, robot]
        center_twist = body.twist.copy()
        center_twist[:, robot] = *compute_point_velocity(body_twist, from_wheels), twist[2]
        self._backend.state = state._replace(
            body=body._replace(
                twist=center_twist,
                gyro_rate=np.where(mask, twist[2], body.gyro_rate),
                hub_speed=np.where(mask, wheel_speed, body.hub_speed),
                rim_speed=np.where(mask, wheel_speed, body.rim_speed),
            )
        )
        self.set_heading_estimate(robot, float(pose[2]))

    def remove(self, robot: int) -> None:
        """Switch a robot off and take it away."""
        self.present[robot], self._failed[robot] = False, True
        self._stop_robots(np.arange(len(self._rows)) == robot, self.pose())

    def _begin_frame(self) -> None:
        inputs = self._take_inputs()
        self._backend.state = begin_planar_frame(self.parameters, self.state, inputs)

    def _advance_cycle(self) -> CycleRecord:
        p, state = self.parameters, self.state
        if state.electronics.cycle % DRAG_CYCLES == 0:
            inputs = state.electronics.inputs
            self._slow = compute_slow_forces(p.body, p.carpet, state.body, inputs)
        self._backend.state, record = advance_cycle(p, state, self._slow)
        return record

    def _end_frame(self) -> dict[int, str]:
        return self._finish_frame(make_report(self.parameters, self.state, self._record))

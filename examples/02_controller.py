"""A controller of one's own, beside one that comes along."""

import numpy as np

import omni_mj as om


class Mine(om.Controller):
    """Proportional control of the pose to which the commands in flight lead."""

    gain: float = (
        3.0  # 1/s; set by controller={"Mine": {"gain": 5.0}}, or --set controller.Mine.gain=5
    )

    def command(self, frame: int, seen: om.Seen) -> np.ndarray:
        """Poses and commands are (n, 3): n robots at once, world frame."""
        target, speed = self.reference.at(frame + self.told.delay_frames, seen.arriving)
        self.channels["gap"] = np.hypot(*(target - seen.arriving)[:, :2].T)  # recorded as own_gap
        return speed + self.gain * (target - seen.arriving)


rect = om.scenario(
    "rect", plant="kinematic", controllers=["comp-flc", Mine], controller={"Mine": {"gain": 5.0}}
)
result = om.run(rect, seeds=range(3), subject="Mine")
print(result.table())

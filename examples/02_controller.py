"""A controller of one's own, beside one that comes along."""

import numpy as np

import omni_mj as om


class Mine(om.Controller):
    """Proportional control of the pose to which the commands in flight lead."""

    # 1/s; set by controller={"Mine": {"gain": 5.0}}, or --set controller.Mine.gain=5
    gain: float = 3.0

    def command(self, frame: int, observation: om.Observation) -> np.ndarray:
        """Poses and commands are (n, 3): n robots at once, world frame."""
        target, speed = self.reference.at(
            frame + self.model.delay_frames, observation.predicted_pose
        )
        self.channels["gap"] = np.hypot(
            *(target - observation.predicted_pose)[:, :2].T
        )  # recorded as channel_gap
        return speed + self.gain * (target - observation.predicted_pose)


rect = om.load_scenario(
    "rect", plant="kinematic", controllers=["comp-flc", Mine], controller={"Mine": {"gain": 5.0}}
)
result = om.run(rect, seeds=range(3), subject="Mine")
print(result.table())

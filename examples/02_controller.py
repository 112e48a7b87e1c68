"""Compare your own controller with a built-in one."""

import numpy as np

import omni_mj as om


class Mine(om.Controller):
    """Proportional control of the predicted pose at the end of the dead time."""

    # A parameter, in 1/s. Set it by controller={"Mine": {"gain": 5.0}}, or on the command line by
    # --set controller.Mine.gain=5
    gain: float = 3.0

    def command(self, frame: int, observation: om.Observation) -> np.ndarray:
        """Return commands (n, 3) for n robots, world frame."""
        target, feedforward = self.reference.at(
            frame + self.model.delay_frames, observation.predicted_pose
        )
        error = target - observation.predicted_pose
        # Recorded as the column channel_predicted_error.
        self.channels["predicted_error"] = np.hypot(error[:, 0], error[:, 1])
        return feedforward + self.gain * error


rect = om.load_scenario(
    "rect", plant="kinematic", controllers=["comp-flc", Mine], controller={"Mine": {"gain": 5.0}}
)
result = om.run(rect, seeds=range(3), subject="Mine")
print(result.table())

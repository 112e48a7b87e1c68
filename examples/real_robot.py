"""Run a team on your own robot. Replace the simulated robot by your vision and your radio."""

from collections import deque

import numpy as np

from omni_control import MotionLimits, Team, TeamModel, TimedReference
from omni_control.controllers.registry import make_controller
from omni_control.kinematics import body_to_world, world_to_body

model = TeamModel(period=1 / 60, delay_frames=6)  # the dead time is the most important number
limits = MotionLimits(speed=2.0, acceleration=1.5)
reference = TimedReference([[0, 0, 0], [1.0, 0.5, 1.5], [0, 0, 0]], limits, model.period)
controller = make_controller("adaptive-comp-flc", model, reference, n=1)
team = Team(controller, start_poses=reference.poses[:1])
pose, radio = reference.poses[0].copy(), deque([np.zeros(3)] * model.delay_frames)

for frame in range(reference.frames + 60):  # 60 times a second, for each frame of your camera
    noise = np.random.default_rng(frame).normal(0, [0.001, 0.001, 0.005])
    command = team.step([pose + noise])  # measured x, y, heading; NaN if not detected
    radio.append(world_to_body(command, team.estimate[:, 2])[0])  # send: forward, left, turn rate
    pose += model.period * 0.9 * body_to_world(radio.popleft(), pose[2])  # delayed, 10 % slow

error_mm = 1000 * np.hypot(*pose[:2])
print(f"arrived within {error_mm:.0f} mm of the start, alpha is {team.alpha_hat[0, 0]:.2f}")

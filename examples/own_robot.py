"""A team's computer on your own robot: put your vision and your radio in place of the fake robot's."""

from collections import deque

import numpy as np

from omni_control import MotionLimits, Team, TeamModel, TimedReference
from omni_control.controllers import make
from omni_control.kinematics import body_to_world, world_to_body

model = TeamModel(
    period=1 / 60, delay_frames=6
)  # what you know of your robot; the dead time matters most
way = TimedReference(
    [[0, 0, 0], [1.0, 0.5, 1.5], [0, 0, 0]], MotionLimits(speed=2.0, acceleration=1.5), model.period
)
team = Team(make("adaptive-comp-flc", model, way, n=1), start=way.poses[:1])
fake, radio = way.poses[0].copy(), deque([np.zeros(3)] * model.delay_frames)

for frame in range(way.frames + 60):  # 60 times a second, whenever your camera has a frame
    vision = fake + np.random.default_rng(frame).normal(
        0, [0.001, 0.001, 0.005]
    )  # x, y, heading; NaN where not seen
    command = team.step([vision])  # [vx, vy, w], m/s and rad/s, world frame
    radio.append(
        world_to_body(command, team.estimate[:, 2])[0]
    )  # forward, to the left, turning: yours to send
    fake += (
        model.period * 0.9 * body_to_world(radio.popleft(), fake[2])
    )  # the fake robot is late and a little weak

print(
    f"arrived within {1000 * np.hypot(*fake[:2]):.0f} mm of the start, alpha is {team.alpha_hat[0, 0]:.2f}"
)

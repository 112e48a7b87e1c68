"""Follow a rolling ball, facing the goal: a new target in every frame."""

from collections import deque

import numpy as np

from omni_control import MotionLimits, TargetReference, Team, TeamModel
from omni_control.controllers.registry import make_controller
from omni_control.kinematics import body_to_world, world_to_body

model = TeamModel(period=1 / 60, delay_frames=6)
reference = TargetReference(MotionLimits(speed=2.5, acceleration=2.0), model.period, n=1)
team = Team(make_controller("adaptive-comp-flc", model, reference, n=1), start_poses=[[0, 0, 0]])
pose, radio, errors = np.zeros(3), deque([np.zeros(3)] * model.delay_frames), []

for frame in range(450):  # the ball rolls along a circle at 1 m/s, and stops after 5.5 s
    angle, is_rolling = 0.8 * min(frame, 330) / 60, frame < 330
    ball = np.array([0.5 + 1.25 * np.sin(angle), 1.75 - 1.25 * np.cos(angle)])
    heading = np.arctan2(-ball[1], 4.5 - ball[0])
    target = [*(ball - 0.15 * np.array([np.cos(heading), np.sin(heading)])), heading]
    team.observe([pose + np.random.default_rng(frame).normal(0, [0.001, 0.001, 0.005])])
    team.set_target(0, target, [is_rolling * np.cos(angle), is_rolling * np.sin(angle), 0])
    command = team.command()
    errors.append(1000 * np.hypot(*(pose - target)[:2]))
    radio.append(world_to_body(command, team.estimate[:, 2])[0])
    pose += model.period * 0.9 * body_to_world(radio.popleft(), pose[2])

rolling, at_rest = np.mean(errors[150:330]), errors[-1]
print(f"mean error: {rolling:.0f} mm behind the rolling ball, {at_rest:.0f} mm at rest")

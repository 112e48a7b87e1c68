"""Follow a rolling ball: a new target in every frame."""

from collections import deque

import numpy as np

from omni_control import MotionLimits, TargetReference, Team, TeamModel
from omni_control.controllers.registry import make_controller
from omni_control.kinematics import body_to_world, world_to_body

GOAL = np.array([4.5, 0.0])
model = TeamModel(period=1 / 60, delay_frames=6)
reference = TargetReference(MotionLimits(speed=2.5, acceleration=2.0), model.period, n=1)
team = Team(make_controller("adaptive-comp-flc", model, reference, n=1), start_poses=[[0, 0, 0]])
pose, radio = np.zeros(3), deque([np.zeros(3)] * model.delay_frames)
ball, ball_velocity, errors = np.array([0.5, 0.5]), np.array([1.0, 0.0]), []


def stay_behind(ball, ball_velocity):
    """Return pose and twist of a target 0.15 m behind the ball that faces the goal."""
    to_goal = (GOAL - ball) / np.hypot(*(GOAL - ball))
    return [*(ball - 0.15 * to_goal), np.arctan2(to_goal[1], to_goal[0])], [*ball_velocity, 0]


for frame in range(450):
    noise = np.random.default_rng(frame).normal(0, [0.001, 0.001, 0.005])
    team.observe([pose + noise])
    target, twist = stay_behind(ball, ball_velocity)
    team.set_target(0, target, twist)
    command = team.command()
    errors.append(1000 * np.hypot(*(pose - target)[:2]))

    radio.append(world_to_body(command, team.estimate[:, 2])[0])
    pose += model.period * 0.9 * body_to_world(radio.popleft(), pose[2])
    turn = 0.8 * model.period  # the ball rolls along a circle at 1 m/s, and stops after 5.5 s
    ball_velocity = ball_velocity @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    ball_velocity *= frame < 330
    ball = ball + model.period * ball_velocity

rolling, at_rest = np.mean(errors[150:330]), errors[-1]
print(f"mean error: {rolling:.0f} mm behind the rolling ball, {at_rest:.0f} mm at rest")

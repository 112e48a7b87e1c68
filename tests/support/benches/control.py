"""A bench of a team's parts: filters, gate, laws and solvers under the names of today."""

from omni_control.controllers.adaptive import anticipate
from omni_control.controllers.lqr import lqr_gain
from omni_control.controllers.nominal import NominalRobot
from omni_control.controllers.quadratic import Limits, minimize
from omni_control.delay import compensation
from omni_control.estimation import gate as vision_gate
from omni_control.estimation import tracking as vision_filter
from omni_control.estimation.alpha import AlphaEstimator
from omni_control.estimation.compliance import HEIGHT_M, Compliance
from omni_control.estimation.gate import Gate
from omni_control.estimation.late import Clock
from omni_control.estimation.robot_filter import CREEP, DISTURBANCE, FRICTION, GAIN, LAG, LATENCY, RobotFilter
from omni_control.estimation.tracking import KalmanFilter
from omni_control.limits import CommandLimits
from omni_control.reference.limits import approach, approach_pose, checked_waypoints, stopping_speed

__all__ = [
    "CREEP",
    "DISTURBANCE",
    "FRICTION",
    "GAIN",
    "HEIGHT_M",
    "LAG",
    "LATENCY",
    "AlphaEstimator",
    "Clock",
    "CommandLimits",
    "Compliance",
    "Gate",
    "KalmanFilter",
    "Limits",
    "NominalRobot",
    "RobotFilter",
    "anticipate",
    "approach",
    "approach_pose",
    "checked_waypoints",
    "compensation",
    "lqr_gain",
    "minimize",
    "stopping_speed",
    "vision_filter",
    "vision_gate",
]

"""A bench of a team's parts: the internal names of `omni_control` that its tests use."""
# ruff: noqa: F401

from omni_control.command_limiter import CommandLimiter
from omni_control.controllers.adaptive import AdaptiveCompFlc, anticipate
from omni_control.controllers.baselines import (
    Lqr,
    NominalRobot,
    Proportional,
    SmithPredictor,
    compute_simc_gain,
)
from omni_control.controllers.mpc import CommandConstraints, solve_quadratic_programs
from omni_control.controllers.registry import (
    CONTROLLERS,
    get_parameters,
    load_controller_class,
    make_controller,
    validate_parameters,
)
from omni_control.delay_compensation import CommandHistory, predict_displacement
from omni_control.errors import OmniError
from omni_control.estimation import vision_tracker as vision_filter
from omni_control.estimation.alpha_estimator import AlphaEstimator
from omni_control.estimation.delayed_measurements import FilterStep
from omni_control.estimation.motion_model import (
    COM_HEIGHT_M,
    CREEP,
    DEAD_TIME,
    DISTURBANCE,
    FRICTION,
    INVERSE_GAIN,
    LAG,
    POSE,
    STATE_SIZE,
    VELOCITY,
    MotionModel,
    YawCoupling,
    compute_contact_speeds,
)
from omni_control.estimation.outlier_gate import OUTLIERS_TO_ACCEPT, REPEATS_TO_ACCEPT, OutlierGate
from omni_control.estimation.robot_ekf import RobotEkf
from omni_control.estimation.vision_tracker import KalmanFilter
from omni_control.fuzzy_rules import LABELS, FuzzyLaw, compute_memberships
from omni_control.kinematics import Array, Kinematics, body_to_world, world_to_body, wrap_angle
from omni_control.reference import Reference
from omni_control.reference.curve_reference import CURVES, Curve, CurveReference
from omni_control.reference.replanned_reference import ARRIVAL_RADIUS_M
from omni_control.reference.sampled_reference import PerRobotReference
from omni_control.traction_limits import compute_traction_limits

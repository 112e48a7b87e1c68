"""Parameters and state of robots on the plant `planar`; see `omni_mj.robot.planar_body`."""

from typing import NamedTuple

from omni_mj.robot.array_ops import Array
from omni_mj.robot.carpet import CarpetParameters, Drag
from omni_mj.robot.onboard import OnboardParameters, OnboardState


class BodyParameters(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given.

    Positions are in the body frame, from the center of mass.
    """

    contact_x: Array  # where wheels touch the carpet, (W, n) m
    contact_y: Array
    edge_x: Array  # from there to the next wheel's contact counter-clockwise, (W, n) m
    edge_y: Array
    jacobian: Array  # J: rim speed per twist of the body, (3, W, n) 1/m, 1/m, 1
    mass_rate: Array  # M / h: mass matrix over a cycle, (3, 3, n) kg/s, kg m/s and kg m^2/s
    # Part of M due to rims and rollers, columns of the two velocities, (3, 2, n) kg and kg m
    rolling_mass: Array
    hub_gain: Array  # G: speed that a hub gains per torque in a cycle, rad/s / (N m)
    hub_viscous_friction: Array  # N m s/rad
    hub_dry_friction: Array  # (W, n) N m
    contact_compliance: Array  # slip speed over torque of the contacts, (W, n) rad/s / (N m)
    rolling_radius: Array  # from the axle to the carpet, (W, n) m
    # Force along the axle over speed, roller_drag + spin_up |w| (1 - exp(-spin_up_speed / |w|)),
    # (W, n) N s/m
    roller_drag: Array
    spin_up: Array
    # Wheel speed at which rollers take on most of the carpet's speed, (W, n) rad/s
    spin_up_speed: Array
    # Torque of rolling resistance, rolling_loss w / (1 + rolling_loss_fade |w|), (W, n) N m
    rolling_loss: Array
    rolling_loss_fade: Array
    # Normal force that turning adds to a wheel, lift w^2 / (1 + lift_fade |w|), (W, n) N
    lift: Array
    lift_fade: Array
    # Ripple of the normal force as rollers pass, (ripple + ripple_growth |w|) times
    # `compute_ripple_wave`, (W, n) N
    ripple: Array
    ripple_growth: Array
    rollers_per_speed: Array  # rollers that pass in a cycle per rim speed, s/rad
    center_x: Array  # center of the wheels, m
    center_y: Array
    push_x: Array  # point at which push forces act, m
    push_y: Array
    mass_height: Array  # center of mass above the carpet, m
    push_height: Array  # point at which push forces act above the center of mass, m
    static_load: Array  # normal force of each wheel at rest, (W, n) N
    # Normal forces of the wheels for a vertical force and two moments, (3, W, n) 1, 1/m, 1/m
    load_distribution: Array
    slope_force_x: Array  # gravity along the carpet, world frame, N
    slope_force_y: Array


class BodyState(NamedTuple):
    """Bodies and wheels of n robots, (n,) unless another shape is given."""

    x: Array  # center of mass, world frame, m
    y: Array
    heading: Array  # rad
    cosine: Array  # of the heading
    sine: Array
    twist: Array  # body frame, (3, n) m/s, m/s, rad/s
    gyro_rate: Array  # turn rate at the gyro, one cycle old, rad/s
    hub_angle: Array  # (W, n) rad
    encoder_angle: Array  # hub angle at the encoders, one cycle old, (W, n) rad
    hub_speed: Array  # (W, n) rad/s
    rim_speed: Array  # (W, n) rad/s
    torque: Array  # t: of the rubber between hub and rim, (W, n) N m
    load: Array  # normal force, (W, n) N
    passed_rollers: Array  # rollers of each wheel that have passed so far, (W, n)
    tilting_moment: Array  # about -y and x, summed over the cycles of a frame, (2, n) N m


class SlowForces(NamedTuple):
    """Forces computed every `DRAG_CYCLES` cycles; (n,) unless another shape is given."""

    drag: Drag
    force: Array  # F: all but the wheels' traction, and its moment, (3, n) N and N m
    tilting_moment: Array  # of drag and pushes, (2, n) N m
    lift: Array  # normal force that turning adds, (W, n) N
    ripple: Array  # amplitude of the normal force's ripple, (W, n) N


class PlanarParameters(NamedTuple):
    """Parameters of n robots on the plant `planar`."""

    onboard: OnboardParameters
    carpet: CarpetParameters
    body: BodyParameters


class PlanarState(NamedTuple):
    """State of n robots on the plant `planar`."""

    onboard: OnboardState
    body: BodyState


class FrameReport(NamedTuple):
    """Motion and telemetry at the end of a frame, (n,) unless another shape is given."""

    pose: Array  # of the center of the wheels, world frame, (3, n) m, m, rad
    twist: Array  # world frame, (3, n) m/s, m/s, rad/s
    topples: Array  # whether the robot would topple
    telemetry: Array  # (10 W + 4, n), see `omni_mj.plants.telemetry.Telemetry`

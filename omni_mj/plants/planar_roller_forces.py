"""Wheels of the plant `planar`: mean forces of rollers on a carpet that yields.

On the plant `mujoco` these forces come from contacts (`omni_mj.mjcf.rollers`). Here they are
tabulated once for each wheel geometry, over the normal force of the wheel.

A roller is an ellipsoid with the radius r and the half length sqrt(R r) on a wheel of the radius R.
At the angle phi from the bottom it extends below the axle by its support function

    h(phi) = (R - r) cos phi + sqrt(r^2 cos^2 phi + R r sin^2 phi).

The inertia of the robot keeps the axle at a constant height z while rollers pass. A roller with
h > z stands on a spring (stiffness K) and a damper (damping c). The wheel turns at w and presses
the roller down at the speed w h'(phi), with the force

    f = max(0, K (h - z) + c w h').

The sum of f over rollers, averaged over the angle of the wheel, is the normal force. This condition
gives z. The same average gives

- the rolling radius, the mean lever arm (h + z) / 2 of the contacts;
- the rolling loss, the torque of f h', almost proportional to w;
- the lift, a force almost proportional to w^2: the damper adds more force as rollers come down than
  it subtracts as they go up, because a contact cannot pull.

At high speed, loss and lift grow more slowly than these powers of w. The ripple of the normal force
is the first harmonic of f.
"""

from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from omni_control.traction_limits import GRAVITY
from omni_mj.config.robot_settings import WheelSettings
from omni_mj.mjcf.rollers import STIFFNESS_N_M, compute_carpet_damping
from omni_mj.robot.array_ops import Array
from omni_mj.robot.planar_dynamics import RollerResponse

# Slow and fast speed of a wheel, at which loss, lift and ripple are computed, rad/s
SPEEDS_RAD_S = 50.0, 100.0
_LOADS_N = 2.0 ** np.arange(-2, 6, 0.25)  # normal forces of the table, N


def interpolate_response(wheels: WheelSettings, load: Array) -> RollerResponse:
    """Return the response of wheels, interpolated over the logarithm of the normal force.

    Args:
        wheels: Geometry of the wheels and rollers.
        load: Normal forces, (W, n) N.
    """
    log_load = np.log(np.maximum(load, _LOADS_N[0]))
    log_loads = np.log(_LOADS_N)
    fields = _tabulate_response(wheels).T
    return RollerResponse(*(np.interp(log_load, log_loads, values) for values in fields))


@lru_cache(maxsize=16)
def _tabulate_response(wheels: WheelSettings) -> Array:
    """Return the fields of `RollerResponse` at each normal force of the table, (forces, fields)."""
    return np.array([_compute_response(wheels, load) for load in _LOADS_N])


def _compute_response(wheels: WheelSettings, load: float) -> RollerResponse:
    """Return the response of one wheel under a normal force in N; see the module."""
    wheel_radius = wheels.radius_m
    roller_radius = wheels.roller_radius_m
    damper = compute_carpet_damping(load / GRAVITY)
    phi = np.linspace(-np.pi / 2, np.pi / 2, 1501)
    rollers_per_point = (phi[1] - phi[0]) * wheels.rollers / (2 * np.pi)
    support = np.sqrt(
        (roller_radius * np.cos(phi)) ** 2 + wheel_radius * roller_radius * np.sin(phi) ** 2
    )
    reach = (wheel_radius - roller_radius) * np.cos(phi) + support  # h
    reach_slope = np.gradient(reach, phi)  # h'

    def compute_forces(height: float, speed: float) -> Array:
        """Return the force f at each angle, times the rollers per point of the grid."""
        forces = STIFFNESS_N_M * (reach - height) + damper * speed * reach_slope
        return rollers_per_point * np.where(reach > height, np.maximum(forces, 0.0), 0.0)

    def find_height(speed: float) -> float:
        """Return the height z of the axle at which the forces carry the normal force."""
        return float(
            brentq(lambda z: compute_forces(z, speed).sum() - load, wheel_radius / 2, wheel_radius)
        )

    rest_height = find_height(0.0)
    rest_forces = compute_forces(rest_height, 0.0)
    turning_forces = [compute_forces(find_height(speed), speed) for speed in SPEEDS_RAD_S]
    is_standing = reach > rest_height
    rolling_radius = rest_forces @ (reach + rest_height) / 2 / load
    axis_height = (roller_radius**2 / support - (reach - rest_height) / 2) * np.cos(phi)  # q
    inverse_squares = axis_height[is_standing] ** -2
    losses = [
        forces @ reach_slope / speed
        for forces, speed in zip(turning_forces, SPEEDS_RAD_S, strict=True)
    ]
    lifts = [(compute_forces(rest_height, speed).sum() - load) / speed**2 for speed in SPEEDS_RAD_S]
    # Complex amplitude of the first harmonic: that of the force is twice these sums, and that of
    # `compute_ripple_wave` is 2 / pi^3.
    harmonic = np.exp(1j * wheels.rollers * phi)
    rest_ripple = rest_forces @ harmonic
    turning_ripple = turning_forces[0] @ harmonic
    ripple = np.pi**3 * rest_ripple.real
    growth = np.pi**3 * (abs(turning_ripple) - abs(rest_ripple)) / SPEEDS_RAD_S[0]
    return RollerResponse(
        rolling_radius,
        rollers_per_point * is_standing.sum(),
        inverse_squares.mean(),
        inverse_squares[0],
        *_fit_fade(*losses),
        *_fit_fade(*lifts),
        ripple,
        np.copysign(growth, ripple),
    )


def _fit_fade(slow: float, fast: float) -> tuple[float, float]:
    """Return a and b of a / (1 + b w), which has these values at the slow and the fast speed."""
    slow_speed, fast_speed = SPEEDS_RAD_S
    fade_s = (slow - fast) / (fast_speed * fast - slow_speed * slow)
    return slow * (1 + slow_speed * fade_s), fade_s

"""Fits of gain K, slip time T and drag by the method of TIGERs Mannheim, and their closed form.

The fits are those of `identifyBotModelV2.m` of Sumatra. u is the speed of the wheels along a move,
v the speed of the body. Both are sampled in the middle of each frame.

A robot that rolls out without motor current is decelerated by the drag D through the contacts and
by the friction torque tau of hubs, gear, motor and wheel bearings. The decelerated mass consists of
the mass m of the body and of the inertia I of the parts that turn with the hubs. With the radius R
of the wheels and the rim directions d

    deceleration = (D_j + sum |d_ij| tau / R) / (m + sum d_ij^2 I / R^2).

The closed form of K and T follows from the slip model (`omni_mj.config.nominal_model`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.optimize import least_squares

from omni_control.kinematics import Array
from omni_mj.config import PERIOD_S, nominal_model
from omni_mj.config.settings import Settings
from omni_mj.studies.slip.slip_moves import AXES, Move, MoveRecord

MIN_LAG_S = 0.001  # added to T |u| in the published model
SUBSTEPS = 4  # of a frame
SETTLING_SAMPLES = 3  # left out after the motors are switched off: 50 ms
AT_REST_M_S = 0.05  # speed at which a roll-out ends
# Half the mean speed of the moves forward, sideways (m/s) and turning (rad/s): the mean speed of a
# roll-out
ROLL_OUT_SPEEDS = np.array([0.5, 0.5, 3.5])


@dataclass(frozen=True)
class SlipFit:
    """Fits to the n moves of one robot.

    Attributes:
        moves: The moves.
        fitted: "gain", "time" and "deceleration" of each move, (n,); NaN if not identifiable.
        measured: Quantity of `slip_study.QUANTITIES` -> mean over the moves; NaN without moves.
        closed_form: Quantity -> value by the closed form of the slip model.
        wheel_speeds: Speed u of the wheels along each move by encoder, (F, n) m/s or rad/s.
        body_speeds: Speed v of the body along each move, (F, n) m/s or rad/s.
    """

    moves: Sequence[Move]
    fitted: Mapping[str, Array]
    measured: Mapping[str, float]
    closed_form: Mapping[str, float]
    wheel_speeds: Array
    body_speeds: Array


def fit_moves(
    settings: Settings, moves: Sequence[Move], record: MoveRecord, mass: float, inertia: float
) -> SlipFit:
    """Fit gain, slip time and deceleration to each move of a robot.

    Args:
        settings: Settings of the robot.
        moves: Moves of the robot, n.
        record: Record of these moves.
        mass: Mass that turns decelerations into drag, kg.
        inertia: Yaw inertia that turns angular decelerations into drag torque, kg m^2.
    """
    move_axes = np.array([move.axis for move in moves])
    directions = np.array([move.direction for move in moves])
    wheel_speeds = (record.wheel_twists * directions).sum(-1)
    body_speeds = (record.body_twists * directions).sum(-1)
    fitted = _fit_each_move(settings, moves, record, wheel_speeds, body_speeds)
    slip, decelerations = nominal_model.compute_creep_law(settings), predict_decelerations(settings)
    masses = {axis: inertia if axis == "turning" else mass for axis in AXES}
    closed_form, measured = dict[str, float](), dict[str, float]()
    for j, axis in enumerate(AXES):
        closed_form[f"gain_{axis}"] = float(slip.gain[j])
        closed_form[f"time_{axis}"] = float(slip.coefficient[j])
        closed_form[f"drag_{axis}"] = float(masses[axis] * decelerations[j])
        is_axis = move_axes == axis
        measured[f"gain_{axis}"] = _mean_of_known(fitted["gain"][is_axis])
        measured[f"time_{axis}"] = _mean_of_known(fitted["time"][is_axis])
        measured[f"drag_{axis}"] = masses[axis] * _mean_of_known(fitted["deceleration"][is_axis])
    return SlipFit(moves, fitted, measured, closed_form, wheel_speeds, body_speeds)


def _fit_each_move(
    settings: Settings,
    moves: Sequence[Move],
    record: MoveRecord,
    wheel_speeds: Array,
    body_speeds: Array,
) -> dict[str, Array]:
    """Return gain, time and deceleration of each move, (n,); see `SlipFit.fitted`."""
    arm = settings.wheels.arm_m
    failed = {failure.row for failure in record.outcome.failures}
    fitted = {name: np.full(len(moves), np.nan) for name in ("gain", "time", "deceleration")}
    for i, move in enumerate(moves):
        if i in failed:
            continue
        frames, turns = slice(move.frames), move.axis == "turning"
        body_speed, wheel_twist = body_speeds[frames, i], record.wheel_twists[frames, i]
        if move.rolls_out:
            at_rest = AT_REST_M_S / arm if turns else AT_REST_M_S
            is_coasting = move.is_coasting(move.frames)
            fitted["deceleration"][i] = mean_deceleration(body_speed, is_coasting, at_rest)
        if turns or not move.rolls_out:
            travel_speed = np.hypot(*wheel_twist[:, :2].T) + arm * np.abs(wheel_twist[:, 2]) * turns
            fitted["gain"][i], fitted["time"][i] = fit_gain_and_time(
                wheel_speeds[frames, i], travel_speed, body_speed
            )
    return fitted


def simulate_slip(gain: float, time: float, u: Array, speed: Array) -> Array:
    """Return v (F,) by v' = (K u - v) / (T |u| + 1 ms), for wheels that start at rest.

    u is linear between samples. In each quarter of a frame the equation is solved exactly, with the
    T |u| of its middle.

    Args:
        gain: K.
        time: T, s^2/m.
        u: Speed by the wheels along one axis, (F,).
        speed: Magnitude of the wheels' velocity, (F,) m/s.
    """
    frames, step = np.arange(len(u)), PERIOD_S / SUBSTEPS
    edges = np.arange(SUBSTEPS * (len(u) - 1) + 1) / SUBSTEPS
    steady, speeds = gain * np.interp(edges, frames, u), np.interp(edges, frames, speed)
    lag = time * (speeds[1:] + speeds[:-1]) / 2 + MIN_LAG_S
    decay = np.exp(-step / lag)
    inputs = steady[1:] - decay * steady[:-1] - lag / step * (1 - decay) * np.diff(steady)
    bands = np.ones((2, len(edges)))  # v[k+1] - decay v[k] = inputs[k], for all steps at once
    bands[1, :-1] = -decay
    v = solve_banded((1, 0), bands, np.append(0.0, inputs))
    return v[::SUBSTEPS]


def fit_gain_and_time(u: Array, speed: Array, v: Array) -> tuple[float, float]:
    """Return K and T by least squares over a whole move, from rest to rest; see `simulate_slip`."""
    fit = least_squares(
        lambda x: simulate_slip(x[0], x[1], u, speed) - v, [1.0, 0.1], bounds=(0.0, np.inf)
    )
    return float(fit.x[0]), float(fit.x[1])


def mean_deceleration(v: Array, is_coasting: np.ndarray, at_rest: float) -> float:
    """Return the mean deceleration of a robot that rolls out; NaN if there are too few samples.

    Args:
        v: Speed along the move, positive, (F,).
        is_coasting: Whether the motors carry no current, for each sample, (F,).
        at_rest: Speed below which the roll-out has ended, in the unit of v.
    """
    coasting = v[is_coasting][SETTLING_SAMPLES:]
    slow = np.flatnonzero(coasting < at_rest)
    coasting = coasting[: slow[0]] if slow.size else coasting
    if len(coasting) < SETTLING_SAMPLES:
        return np.nan
    return float((coasting[0] - coasting[-1]) / (len(coasting) - 1) / PERIOD_S)


def predict_decelerations(settings: Settings) -> Array:
    """Return the closed-form decelerations of roll-outs at `ROLL_OUT_SPEEDS`.

    Returns:
        Forward and sideways in m/s^2, turning in rad/s^2, (3,).
    """
    wheels, body, motor = settings.wheels.kinematics, settings.body, settings.motor
    inertia = np.array([body.mass_kg, body.mass_kg, body.yaw_inertia_kg_m2])
    wheel_rates = np.abs(wheels.matrix) / wheels.radius * ROLL_OUT_SPEEDS  # rad/s
    friction = settings.hub_friction_nm + motor.wheel_viscous_friction_nm_s * wheel_rates
    hubs = (np.abs(wheels.matrix) * friction).sum(0) / wheels.radius
    rotor_inertia = motor.rotor_inertia_kg_m2 * motor.gear_ratio**2
    rotors = rotor_inertia / wheels.radius**2 * (wheels.matrix**2).sum(0)
    return (nominal_model.compute_creep_law(settings).drag + hubs) / (inertia + rotors)


def _mean_of_known(values: Array) -> float:
    """Return the mean of values that are not NaN; NaN if there are none."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan

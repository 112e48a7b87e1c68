"""The fits of TIGERs Mannheim (`identifyBotModelV2.m` of Sumatra), and the closed form that they must find.

u is what the wheels do, v what the robot does along a move; both are sampled in the middle of each
frame.

Rolling out without current, drag D through the contacts and friction of hubs, tau for gear, motor
and wheel bearings, slow the body, of mass m, and what turns with the hubs, of the inertia I; with
the wheels' radius R and directions d

    deceleration = (D_j + sum |d_ij| tau / R) / (m + sum d_ij^2 I / R^2).

Gain and time follow from the law of creep (`omni_mj.config.team_model`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.optimize import least_squares

from omni_control.kinematics import Array
from omni_mj.config import team_model
from omni_mj.config.settings import PERIOD_S, Settings
from omni_mj.robot.motors import Motor
from omni_mj.studies.slip.slip_moves import AXES, Move, Record

FLOOR_S = 0.001  # added to T |u| in their law
SUBSTEPS = 4  # of a frame
SETTLING = 3  # samples that are left out after a change: 50 ms
AT_REST = 0.05  # m/s: a roll-out is looked at until then
ROLLING = np.array([0.5, 0.5, 3.5])  # half of the mean speed of the moves, m/s and rad/s


@dataclass(frozen=True)
class SlipFit:
    """What came out of one robot.

    Attributes:
        moves: That it drove, n of them.
        fitted: gain, time and deceleration of each move, (n,); NaN where a move does not tell.
        measured: Means of these by `slip.QUANTITIES`; NaN where nothing tells.
        law: The same, of what the law of creep says in closed form.
        wheels: Speed along each move by the encoders, (F, n).
        body: Speed of the body, (F, n).
    """

    moves: Sequence[Move]
    fitted: Mapping[str, Array]
    measured: Mapping[str, float]
    law: Mapping[str, float]
    wheels: Array
    body: Array


def fit_moves(
    settings: Settings, moves: Sequence[Move], record: Record, mass: float, inertia: float
) -> SlipFit:
    """Fit everything that a record tells.

    Args:
        settings: Of the robot.
        moves: That it drove.
        record: Of these.
        mass: With which decelerations are turned into drag, kg.
        inertia: The same of decelerations on the spot, kg m^2.
    """
    kinds = np.array([move.kind for move in moves])
    turning, arm = kinds == "turning", settings.wheels.arm_m
    axes = np.eye(3)[[AXES.index(kind) for kind in kinds]] * np.sign(
        [[move.speed] for move in moves]
    )
    wheels, body = ((values * axes).sum(-1) for values in (record.wheels, record.body))
    failed = {failure.row for failure in record.simulation.failures}
    fitted = {name: np.full(len(moves), np.nan) for name in ("gain", "time", "deceleration")}
    rolling = np.where(
        turning, body, np.hypot(record.body[..., 0], record.body[..., 1])
    )  # a robot let go may turn
    for i, move in enumerate(moves):
        if i in failed:
            continue
        used = slice(move.frames)
        if move.rolls_out:
            at_rest = AT_REST / arm if turning[i] else AT_REST
            fitted["deceleration"][i] = fit_drag(
                rolling[used, i], move.is_free(move.frames), at_rest
            )
        if turning[i] or not move.rolls_out:
            speed = (
                np.hypot(*record.wheels[used, i, :2].T)
                + arm * np.abs(record.wheels[used, i, 2]) * turning[i]
            )
            fitted["gain"][i], fitted["time"][i] = fit_law(wheels[used, i], speed, body[used, i])
    law = dict[str, float]()
    creep, decelerations = team_model.creep(settings), roll_out_decelerations(settings)
    weights = {axis: inertia if axis == "turning" else mass for axis in AXES}
    for j, (axis, weight) in enumerate(weights.items()):
        law |= {f"gain_{axis}": float(creep.gain[j]), f"time_{axis}": float(creep.time[j])}
        law[f"drag_{axis}"] = float(weight * decelerations[j])
    measured = {
        f"{name}_{axis}": _mean(fitted[name][kinds == axis])
        for name in ("gain", "time")
        for axis in AXES
    }
    measured |= {
        f"drag_{axis}": w * _mean(fitted["deceleration"][kinds == axis])
        for axis, w in weights.items()
    }
    return SlipFit(moves, fitted, measured, law, wheels, body)


def follow(gain: float, time: float, u: Array, speed: Array) -> Array:
    """Return v (F,) by v' = (K u - v) / (T |u| + 1 ms), for wheels that start at rest.

    Between two samples wheels are taken to speed up evenly; in each quarter of a frame the law is
    solved exactly, with the T |u| of its middle.

    Args:
        gain: K.
        time: T, s^2/m.
        u: Velocity by the wheels along one axis, (F,).
        speed: Magnitude of the wheels' velocity, m/s, (F,).
    """
    frames, step = np.arange(len(u)), PERIOD_S / SUBSTEPS
    edges = np.arange(SUBSTEPS * (len(u) - 1) + 1) / SUBSTEPS
    wanted, travelled = gain * np.interp(edges, frames, u), np.interp(edges, frames, speed)
    lag = time * (travelled[1:] + travelled[:-1]) / 2 + FLOOR_S
    kept = np.exp(-step / lag)
    gained = wanted[1:] - kept * wanted[:-1] - lag / step * (1 - kept) * np.diff(wanted)
    bands = np.ones((2, len(edges)))  # v_1 - kept v_0 = gained, for all steps at once
    bands[1, :-1] = -kept
    v: Array = solve_banded((1, 0), bands, np.append(0.0, gained))
    return v[::SUBSTEPS]


def fit_law(u: Array, speed: Array, v: Array) -> tuple[float, float]:
    """Return K and T by least squares over the whole move, from standing still to standing still; see `follow`."""
    fit = least_squares(
        lambda x: follow(x[0], x[1], u, speed) - v, [1.0, 0.1], bounds=(0.0, np.inf)
    )
    return float(fit.x[0]), float(fit.x[1])


def fit_drag(v: Array, free: np.ndarray, at_rest: float = AT_REST) -> float:
    """Return the mean deceleration of a robot that rolls out; NaN if there are too few samples.

    Args:
        v: Speed along the move, (F,), positive.
        free: In which samples the motors carry no current, (F,).
        at_rest: Speed below which nothing is looked at.
    """
    rolling = v[free][SETTLING:]
    slow = np.flatnonzero(rolling < at_rest)
    rolling = rolling[: slow[0]] if slow.size else rolling
    return (
        float((rolling[0] - rolling[-1]) / (len(rolling) - 1) / PERIOD_S)
        if len(rolling) >= SETTLING
        else np.nan
    )


def roll_out_decelerations(settings: Settings) -> Array:
    """Return those of the closed form, at the speeds of `ROLLING`: forward, sideways, m/s^2, and turning, rad/s^2."""
    wheels, body, motor = settings.wheels.kinematics, settings.body, Motor.of(settings.motor)
    inertia = np.array([body.mass_kg, body.mass_kg, body.yaw_inertia_kg_m2])
    turning = np.abs(wheels.matrix) / wheels.radius * ROLLING  # of the wheels, rad/s
    friction = settings.hub_friction_nm + motor.wheel_viscous * turning
    hubs = (np.abs(wheels.matrix) * friction).sum(0) / wheels.radius
    rotors = motor.inertia * motor.gear**2 / wheels.radius**2 * (wheels.matrix**2).sum(0)
    return np.asarray((team_model.creep(settings).drag + hubs) / (inertia + rotors))


def _mean(values: Array) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan

"""Helpers to test plants: settings, rows, data of the default robot, drives without radio."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from omni_mj.config.resolve import resolve_settings
from omni_mj.config.rows import Row
from omni_mj.config.settings import Settings
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants import Plant
from omni_mj.plants.mujoco_plant import MujocoPlant
from omni_mj.plants.planar_plant import PlanarPlant

# Data of the default robot, from its file only
_SETTINGS = resolve_settings()
MASS_KG, COM_HEIGHT_M = _SETTINGS.body.mass_kg, _SETTINGS.body.com_height_m
AZIMUTHS = np.radians(_SETTINGS.wheels.azimuths_deg)
ARM_M, RADIUS_M = _SETTINGS.wheels.arm_m, _SETTINGS.wheels.radius_m
ROLLER_RADIUS_M, ROLLERS = _SETTINGS.wheels.roller_radius_m, _SETTINGS.wheels.rollers
GRAVITY = 9.81
# Positions of the wheels' contacts, and directions in which positive wheel speeds drive the robot,
# body frame (equation 3)
OUTWARD = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS)], axis=1)
CONTACTS = ARM_M * OUTWARD
TANGENTS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS)], axis=1)

PlantOf = Callable[[list[Settings]], Any]  # makes robots, one for each of the settings
FRAME_S = 1 / 60
SIGMAS = 5  # tolerance of a statistic in its standard errors
ROBOT = "tigers-v2016"
# A stiff wheel loop. It cannot be stiffer: without its rim, the default robot's hub gains 1.2 rad/s
# per cycle and volt, and its encoder is a cycle late. With 1 V s/rad in place of 0.4, currents
# oscillate by 2 A at rest and by 6 A in motion.
STIFF = {"kp": 0.4, "ki": 20.0, "turn_rate_gain": 0.0}
# Wheels without losses
NO_FRICTION = {"roller_friction": 0.0, "gear_friction_nm": 0.0, "roller_damping_nm_s": 0.0}
LOSSLESS = NO_FRICTION | {"efficiency": 1.0}


def with_settings(**sections: dict[str, Any]) -> Settings:
    """Return the default settings with fields of some sections replaced."""
    return resolve_settings().replace(**sections)


def compute_loads(acceleration: ArrayLike) -> NDArray:
    """Return the forces of four springs, (4,) N, under an acceleration, body axes, (2,) m/s^2."""
    sums = np.array([np.ones(4), *CONTACTS.T])
    moments = [GRAVITY, *(-np.asarray(acceleration) * COM_HEIGHT_M)]
    return np.asarray(MASS_KG * sums.T @ np.linalg.solve(sums @ sums.T, moments))


def noiseless(**sections: dict[str, Any]) -> Settings:
    """Return settings as `with_settings`, with an ideal gyro and numpy."""
    sections["physics"] = {"backend": "numpy"} | sections.get("physics", {})
    sections["sensors"] = {"gyro_noise_rad_s": 0.0, "gyro_bias_rad_s": 0.0} | sections.get(
        "sensors", {}
    )
    return with_settings(**sections)


def rows(
    settings: Sequence[Settings],
    seeds: Sequence[int] | None = None,
    per_world: int = 1,
    robot: str = ROBOT,
) -> list[Row]:
    """Return a row for each of `settings`, `per_world` of them in a world."""
    seeds = seeds or [0] * len(settings)
    return [
        Row(i // per_world, i % per_world, "", seed, chosen, robot)
        for i, (seed, chosen) in enumerate(zip(seeds, settings, strict=True))
    ]


def mujoco(
    settings: Sequence[Settings],
    start: ArrayLike | None = None,
    seeds: Sequence[int] | None = None,
    **options: Any,
) -> MujocoPlant:
    """Return the plant mujoco with a robot for each of `settings`. Default: at the origin."""
    threads = options.pop("threads", None)
    poses = np.zeros((len(settings), 3)) if start is None else np.asarray(start, float)
    return MujocoPlant(rows(settings, seeds, **options), poses, threads)


def receive_at_once(command: NDArray, heading: NDArray | None = None) -> ReceivedCommand:
    """Return commands (n, 3) that arrive without delay, with headings (n,) or NaN."""
    n = len(command)
    return ReceivedCommand(
        command, np.full(n, np.nan) if heading is None else heading, np.zeros(n, int)
    )


def drive(plant: Plant, commands: NDArray, age: NDArray | int = 0) -> NDArray:
    """Return poses (frames + 1, n, 3) under commands (frames, n, 3); no robot may fail.

    Vision sends the true heading with an age in frames.
    """
    poses = [plant.pose()]
    ages = np.broadcast_to(age, commands.shape[1])
    for command in commands:
        assert plant.advance(ReceivedCommand(command, plant.pose()[:, 2], ages)) == {}
        poses.append(plant.pose())
    return np.array(poses)


def constant(command: ArrayLike, frames: int, n: int) -> NDArray:
    """Return the same commands, (3,) or (n, 3), for every frame."""
    return np.broadcast_to(np.asarray(command, float), (frames, n, 3))


def ramp(twists: ArrayLike, acceleration: ArrayLike, frames: int) -> NDArray:
    """Return commands (frames, n, 3) whose norm ramps up to twists (n, 3) at an acceleration."""
    twists = np.asarray(twists, float)
    frame = np.arange(1, frames + 1)[:, None]
    fraction = np.minimum(
        1.0, np.asarray(acceleration) * FRAME_S * frame / np.linalg.norm(twists, axis=1)
    )
    return fraction[..., None] * twists


# Robots that stand when their faults begin
# Rim and rollers turn along with a body that slides away under them (see test_sliding.py).
RIM_INERTIA = 1e-6 + 16 * (0.0015 * 0.0225**2 + 6e-8)
ROLLING_KG = RIM_INERTIA / RADIUS_M**2 * (TANGENTS**2).sum(0)
ICE: dict[str, Any] = {
    "carpet": {"friction": 0.01, "rolling_resistance": 0.0},
    "drivetrain": {"roller_friction": 0.0},
}
SETTLE_FRAMES, REST = 12, np.zeros(3)  # frames after which a robot is at rest
MAX_DRIFT = 1e-5  # m, rad: twice the motion of a robot on ice in that time
TWO_ROLLERS: dict[str, Any] = {"wheels": {"model": "two-rollers"}}


def with_faults(*faults: dict[str, Any], **sections: Any) -> Settings:
    """Return settings with faults. Default start: the frame `SETTLE_FRAMES`."""
    return noiseless(
        **sections, fault=[{"start_s": SETTLE_FRAMES * FRAME_S, **fault} for fault in faults]
    )


def on_all_wheels(kind: str, **values: Any) -> list[dict[str, Any]]:
    """Return a fault of each wheel from the start on."""
    return [{"kind": kind, "wheel": wheel, "start_s": 0.0, **values} for wheel in (1, 2, 3, 4)]


def stand_still(plant: Plant, frames: int = SETTLE_FRAMES) -> NDArray:
    """Return poses of robots with zero commands."""
    return drive(plant, constant(REST, frames, len(plant.pose())))


def planar(settings: list[Settings], start: ArrayLike | None = None) -> PlanarPlant:
    """Return robots on the plant planar. Default: at the origin."""
    return PlanarPlant(
        rows(settings), np.zeros((len(settings), 3)) if start is None else np.asarray(start, float)
    )


def two_rollers(settings: list[Settings], start: ArrayLike | None = None) -> MujocoPlant:
    """Return robots on the plant mujoco, with the wheels that compute fastest."""
    return mujoco([s.replace(**TWO_ROLLERS) for s in settings], start)


WHEELED_PLANTS = pytest.mark.parametrize(
    "plant_of", [two_rollers, planar], ids=["mujoco", "planar"]
)


# Internal values of plants
def estimated_heading(plant: MujocoPlant | PlanarPlant) -> NDArray:
    """Return the firmware's headings, (n,) rad."""
    heading: NDArray = plant.electronics.firmware.heading
    return heading


def encoder_angles(plant: MujocoPlant | PlanarPlant) -> NDArray:
    """Return angles by the encoders' last counts, (n, W) rad."""
    counts: NDArray = plant.electronics.firmware.encoder_count
    return (counts / plant.parameters.electronics.firmware.counts_per_rad).T


def read_sensors(plant: MujocoPlant) -> list[float]:
    """Return encoders and gyro of the first robot, as its firmware reads them next, rad, rad/s."""
    gyro, angles = plant._sensor_values
    return [*angles[:, 0], gyro[0]]


def wheel_loads(plant: MujocoPlant | PlanarPlant) -> NDArray:
    """Return normal forces of the wheels, (n, W) N."""
    if isinstance(plant, MujocoPlant):
        return plant._views.load.get().T
    load: NDArray = plant._backend.state.body.load
    return load.T


def stop_robot(plant: MujocoPlant, robot: int) -> None:
    """Stop a robot as if it had failed."""
    plant._stop_rows(np.array([robot]), np.zeros(0, int))


def changeable_values(plant: MujocoPlant) -> list[NDArray]:
    """Return the values of robots and worlds that faults change, each with robots first."""
    names = (
        "body_mass",
        "body_subtreemass",
        "body_ipos",
        "body_inertia",
        "body_iquat",
        "opt.gravity",
    )
    p = plant.parameters
    electronics = [
        p.carpet.friction,
        p.carpet.friction_factor.T,
        plant._views.center_of_mass.T,
        p.electronics.motors.cold_torque_constant.T,
    ]
    fields = [plant._batch.expand(name) for name in names]
    return [np.array(values) for values in (*fields, *electronics)]


def set_twist(plant: PlanarPlant, twist: ArrayLike) -> None:
    """Set the first robot's twist (3,), body frame, with wheels that roll without slip."""
    state, body = plant.state, plant.state.body
    twists, wheels = body.twist.copy(), body.hub_speed.copy()
    twists[:, 0] = twist
    wheels[:, 0] = np.asarray(twist) @ plant.parameters.body.jacobian[:, :, 0]
    moving = body._replace(twist=twists, hub_speed=wheels, rim_speed=wheels.copy())
    plant._backend.state = state._replace(body=moving)


def remove_roller_losses(plant: PlanarPlant) -> None:
    """Remove drag, rolling loss, lift and ripple of the rollers."""
    body = plant.parameters.body
    zero = np.zeros_like(body.roller_drag)
    names = "rolling_loss", "lift", "ripple", "ripple_growth"
    response = body.response._replace(**dict.fromkeys(names, zero))
    body = body._replace(roller_drag=zero, spin_up=zero, response=response)
    plant.parameters = plant.parameters._replace(body=body)


def mass_matrices(plant: PlanarPlant) -> tuple[NDArray, NDArray]:
    """Return the first robot's mass matrices: of body, rims and rollers, and of hubs, (3, 3)."""
    body = plant.parameters.body
    rims = body.jacobian[:, :, 0]
    return body.mass_rate[..., 0] / 960, rims @ rims.T / (960 * body.hub_gain[0])

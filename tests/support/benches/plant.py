"""A test bench for plants: settings, rows, the default robot's numbers, and driving without radio and camera."""

from collections.abc import Sequence
from typing import Any

import mujoco as mj
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from omni_mj.config.rows import Row
from omni_mj.config.settings import Settings
from omni_mj.network.radio import ReceivedCommand
from omni_mj.plants import Plant
from omni_mj.plants.mujoco import MujocoPlant
from omni_mj.plants.planar import PlanarPlant

# The default robot: the numbers of its file, and nothing that the code makes of them.
_SETTINGS = Settings()
MASS_KG, COM_HEIGHT_M = _SETTINGS.body.mass_kg, _SETTINGS.body.com_height_m
AZIMUTHS = np.radians(_SETTINGS.wheels.azimuths_deg)
ARM_M, RADIUS_M = _SETTINGS.wheels.arm_m, _SETTINGS.wheels.radius_m
ROLLER_RADIUS_M, ROLLERS = _SETTINGS.wheels.roller_radius_m, _SETTINGS.wheels.rollers
GRAVITY = 9.81
# Where the wheels touch, and the directions in which positive wheel speeds push the robot, in its
# frame (equation 3).
CONTACTS = ARM_M * np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS)], axis=1)
TANGENTS = np.stack([-np.sin(AZIMUTHS), np.cos(AZIMUTHS)], axis=1)
OUTWARD = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS)], axis=1)

FRAME_S = 1 / 60
SIGMAS = 5  # of a statistic's own spread
ROBOT = "tigers-v2016"
# A stiff wheel loop. Not stiffer: free of its rim, the default robot's hub gains 1.2 rad/s a cycle
# and volt, and is heard of a cycle late. With 1 V s/rad in place of 0.4, currents swing by 2 A at
# rest and by 6 A in motion.
STIFF = {"kp": 0.4, "ki": 20.0, "turn_rate_gain": 0.0}


def with_settings(**sections: dict[str, Any]) -> Settings:
    """The defaults with fields of some sections replaced."""
    return Settings().replace(**sections)


def quiet(**sections: dict[str, Any]) -> Settings:
    """As above, with a gyro that makes no error, computed by numpy."""
    sections["physics"] = {"backend": "numpy"} | sections.get("physics", {})
    sections["sensors"] = {"gyro_noise_rad_s": 0.0, "gyro_bias_rad_s": 0.0} | sections.get(
        "sensors", {}
    )
    return with_settings(**sections)


def rows(
    settings: Sequence[Settings],
    seeds: Sequence[int] | None = None,
    places: int = 1,
    robot: str = ROBOT,
) -> list[Row]:
    """A row for each of `settings`, `places` of them in a world."""
    seeds = seeds or [0] * len(settings)
    return [
        Row(i // places, i % places, "", seed, chosen, robot)
        for i, (seed, chosen) in enumerate(zip(seeds, settings, strict=True))
    ]


def mujoco(
    settings: Sequence[Settings],
    start: ArrayLike | None = None,
    seeds: Sequence[int] | None = None,
    **more: Any,
) -> MujocoPlant:
    """The physical plant with a robot for each of `settings`, at the origin if nothing else is said."""
    threads = more.pop("threads", None)
    poses = np.zeros((len(settings), 3)) if start is None else np.asarray(start, float)
    return MujocoPlant(rows(settings, seeds, **more), poses, threads)


def drive(plant: Plant, commands: NDArray, age: NDArray | int = 0) -> NDArray:
    """Poses (frames + 1, n, 3) under commands (frames, n, 3); vision sees the true heading, said to be `age` old.

    No robot may fail.
    """
    poses = [plant.pose()]
    ages = np.broadcast_to(age, commands.shape[1])
    for command in commands:
        assert plant.advance(ReceivedCommand(command, plant.pose()[:, 2], ages)) == {}
        poses.append(plant.pose())
    return np.array(poses)


def constant(command: ArrayLike, frames: int, n: int) -> NDArray:
    """The same commands, (3,) or (n, 3), in every frame."""
    return np.broadcast_to(np.asarray(command, float), (frames, n, 3))


def ramp(twists: ArrayLike, acceleration: ArrayLike, frames: int) -> NDArray:
    """Commands (frames, n, 3) that speed up to twists (n, 3), each at a rate (1/s^2 of its size), then stay."""
    twists = np.asarray(twists, float)
    frame = np.arange(1, frames + 1)[:, None]
    share = np.minimum(
        1.0, np.asarray(acceleration) * FRAME_S * frame / np.linalg.norm(twists, axis=1)
    )
    return share[..., None] * twists


# Robots that meet faults from the frame on at which they stand.
# Rim and rollers turn along with a body that slides away under them (see test_sliding.py).
RIM_INERTIA = 1e-6 + 16 * (0.0015 * 0.0225**2 + 6e-8)
ROLLING_KG = RIM_INERTIA / RADIUS_M**2 * (TANGENTS**2).sum(0)
ICE: dict[str, Any] = {
    "carpet": {"friction": 0.01, "rolling_resistance": 0.0},
    "drivetrain": {"roller_friction": 0.0},
}
SETTLE, REST = 12, np.zeros(3)  # frames after which a robot stands
STILL = 1e-5  # m, rad: what it moves meanwhile on ice, twice over
FAST: dict[str, Any] = {"wheels": {"model": "two-rollers"}}


def meets(*faults: dict[str, Any], **sections: Any) -> Settings:
    """A robot to which these happen, from the frame `SETTLE` on if nothing else is said."""
    return quiet(**sections, fault=[{"start_s": SETTLE * FRAME_S, **each} for each in faults])


def standing(plant: Plant, frames: int = SETTLE) -> NDArray:
    """Poses of robots that are told to stand."""
    return drive(plant, constant(REST, frames, len(plant.pose())))


def planar(settings: list[Settings], start: ArrayLike | None = None) -> PlanarPlant:
    """Robots on the planar plant, at the origin if nothing else is said."""
    return PlanarPlant(
        rows(settings), np.zeros((len(settings), 3)) if start is None else np.asarray(start, float)
    )


def two_rollers(settings: list[Settings], start: ArrayLike | None = None) -> MujocoPlant:
    """Robots on the plant of bodies, with the wheels that cost least."""
    return mujoco([each.replace(**FAST) for each in settings], start)


ON_WHEELS = pytest.mark.parametrize("plant_of", [two_rollers, planar], ids=["mujoco", "planar"])


# What is inside plants.
def held_heading(plant: MujocoPlant | PlanarPlant) -> NDArray:
    """Headings that robots estimate, (n,) rad."""
    heading: NDArray = plant.onboard.firmware.heading
    return heading


def encoder_angles(plant: MujocoPlant | PlanarPlant) -> NDArray:
    """Angles by the encoders' last counts, (n, W) rad."""
    counts: NDArray = plant.onboard.firmware.encoder_count
    return (counts / plant.parameters.onboard.firmware.counts_per_rad).T


def sensed(plant: MujocoPlant) -> list[float]:
    """What the first robot's encoders and gyro show next, rad and rad/s."""
    gyro, angles = plant._sensor_values
    return [*angles[:, 0], gyro[0]]


def wheel_loads(plant: MujocoPlant | PlanarPlant) -> NDArray:
    """Loads of wheels, (n, W) N."""
    if isinstance(plant, MujocoPlant):
        return plant._views.load.get().T
    load: NDArray = plant._backend.state.body.load
    return load.T


def stop(plant: MujocoPlant, robot: int) -> None:
    """Have a robot fail."""
    plant._stop_rows([robot], [])


def numbers(plant: MujocoPlant) -> list[NDArray]:
    """What faults change of robots and worlds, each with robots first."""
    names = (
        "body_mass",
        "body_subtreemass",
        "body_ipos",
        "body_inertia",
        "body_iquat",
        "opt.gravity",
    )
    p = plant.parameters
    onboard = [
        p.carpet.friction,
        p.carpet.friction_factor.T,
        plant._views.center_of_mass.T,
        p.onboard.motors.cold_torque_constant.T,
    ]
    return [np.array(each) for each in (*(plant._batch.expand(name) for name in names), *onboard)]


def throw(plant: PlanarPlant, twist: ArrayLike) -> None:
    """Have the first robot of the planar plant move with a twist (3,) in its frame, its wheels rolling along."""
    state, body = plant.state, plant.state.body
    twists, wheels = body.twist.copy(), body.hub_speed.copy()
    twists[:, 0] = twist
    wheels[:, 0] = np.asarray(twist) @ plant.parameters.body.jacobian[:, :, 0]
    moving = body._replace(twist=twists, hub_speed=wheels, rim_speed=wheels.copy())
    plant._backend.state = state._replace(body=moving)


def without_losses(plant: PlanarPlant) -> None:
    """Have rollers cost nothing."""
    body = plant.parameters.body
    zero = np.zeros_like(body.roller_drag)
    names = "roller_drag", "spin_up", "rolling_loss", "lift", "ripple", "ripple_growth"
    plant.parameters = plant.parameters._replace(body=body._replace(**dict.fromkeys(names, zero)))


def inertias(plant: PlanarPlant) -> tuple[NDArray, NDArray]:
    """Of the first robot: of body, rims and rollers, and of hubs, (3, 3) each."""
    body = plant.parameters.body
    rims = body.jacobian[:, :, 0]
    return body.mass_rate[..., 0] / 960, rims @ rims.T / (960 * body.hub_gain[0])


def arrays(model: mj.MjModel) -> dict[str, Any]:
    """Every array and number of a model by name, options included; not names and keyframes."""
    skipped = ("_", "name", "key_", "nname", "nkey", "nbuffer", "signature")
    values = {}
    for owner, prefix in ((model, ""), (model.opt, "opt."), (model.stat, "stat.")):
        for name in dir(owner):
            value = getattr(owner, name) if not name.startswith(skipped) else None
            if isinstance(value, np.ndarray | int | float):
                values[prefix + name] = value
    return values

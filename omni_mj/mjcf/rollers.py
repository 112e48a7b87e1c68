"""Rollers: their contacts with the carpet, and wheels that keep only two of them.

**Contacts.** MuJoCo's contacts between rollers and carpet never slide. Under MuJoCo's elliptic
cone, a sliding contact is pushed out of the carpet: the reference acceleration of the tangential
directions also acts on the normal one, which then approaches a lift of friction x b_t v / k (b_t,
k: tangential damping and normal stiffness per mass). With a spring of 50 Hz, half damped, and
friction that acts within 3.5 ms, the lift is 72 mm at 1.5 m/s. Therefore the friction coefficient
of the contacts is very high, and the creep and sliding of the rubber happen on a hinge between hub
and rim (`omni_mj.robot.wheel_carpet_forces`).

Normal to the carpet a contact is a spring and a damper, with a mass that keeps it soft enough for
the solver,

    f = -K r - c r' - m r'',    K = 1e5 N/m,  m = 1 kg,  c = 2 zeta sqrt(K (M + m)),  zeta = 0.2

with M a quarter of the robot's mass. K and zeta are assumptions, because nobody has measured a
carpet. The robot sinks in by 0.06 mm. MuJoCo's constraint is r'' + R f = -b r' - k r with
R = (1 - d)/d A, where A is the inverse of the effective mass of the two bodies at the contact. It
follows that R = 1/m, k = K/m, b = c/m, d = A/(A + 1/m). Friction is a pure damper with a time
constant of 1.7 ms, in which a roller that comes down reaches the speed of the carpet.

**Two rollers per wheel.** One or two rollers of a wheel touch the carpet; the others only carry
mass. `reduce_rollers` keeps two neighbors of each wheel and adds the mass of the others to its rim.
When one of the two has reached the bottom and the other is a full pitch away,
`omni_mj.plants.mjdata_views.RobotViews.wrap_rollers` turns the rim back by one pitch. The rollers
are equal: the second roller takes the position and the spin of the one at the bottom. The first
one, then 2 mm above the carpet, becomes the next roller. Hub and encoder do not change, because
only the slip hinge is turned back.

Mass matrix. A lumped roller adds its mass, and its inertia by the parallel axis theorem, to the
rim. Rim and remaining rollers together have the mass, center of mass and inertia of the full wheel
at every angle, because equal rollers are symmetric about the axle. Only the spin of the lumped
rollers is lost: they turn with the chassis about their axes, where their bearings would let them
lag behind. That adds at most 0.9e-6 kg m^2 to the chassis's 0.012.

Spin. A roller reaches the carpet with little spin: since its last contact 14 pitches have passed
(55 ms at 100 rad/s), and its bearing slows it down within 15 ms. Spinning it up takes the impulse
I v / q^2, 0.9 g times the sideways speed v, where q is the distance from its axis to the carpet.
This is a further drag, of one roller per pitch. The next roller therefore starts without spin.
"""

import math
from typing import Any

import mujoco
import numpy as np

from omni_mj.mjcf.model_measurements import compute_composite_inertia, set_inertial
from omni_mj.mjcf.part_recognition import (
    RETAINED_ROLLERS,
    RobotIndices,
    compute_initial_kinematics,
)

STIFFNESS_N_M = 1e5
ADDED_MASS_KG = 1.0
DAMPING_RATIO = 0.2
FRICTION_RATE_HZ = 604.8  # 1/s, inverse of the time constant of friction, 1.7 ms
FRICTION_STIFFNESS_RATIO = 45.0  # relative to that normal to the carpet: MuJoCo's impratio
UNREACHABLE_FRICTION = 5.0  # friction coefficient at which no contact slides
MAX_IMPEDANCE = 0.9999  # MuJoCo's limit of d


def compute_carpet_damping(wheel_load_kg: float) -> float:
    """Return the damping of the carpet under a roller, N s/m, for the mass on a wheel."""
    return 2 * DAMPING_RATIO * math.sqrt(STIFFNESS_N_M * (wheel_load_kg + ADDED_MASS_KG))


def make_roller_contact(
    robot: mujoco.MjModel, rollers: np.ndarray, wheel_load_kg: float
) -> dict[str, Any]:
    """Return the parameters of a contact pair of carpet and roller, with MuJoCo's names.

    Args:
        robot: Compiled model of the robot alone.
        rollers: Bodies of its rollers.
        wheel_load_kg: Mass on a wheel.
    """
    inverse_mass = float(robot.body_invweight0[rollers, 0].max())
    d = inverse_mass / (inverse_mass + 1 / ADDED_MASS_KG)
    k = STIFFNESS_N_M / ADDED_MASS_KG
    b = compute_carpet_damping(wheel_load_kg) / ADDED_MASS_KG
    return {
        "solref": [-k * d, -b * d],  # MuJoCo divides by d
        "solreffriction": [-1.0, -FRICTION_RATE_HZ * d],
        "solimp": [d, d, 1.0, 0.5, 2.0],
        "friction": [UNREACHABLE_FRICTION, UNREACHABLE_FRICTION, 0.005, 0.0001, 0.0001],
    }


def reduce_rollers(spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices) -> None:
    """Keep two rollers per wheel, the one at the bottom and the next, and make the rims heavier.

    Each step of the compiled result must be followed by
    `omni_mj.plants.mjdata_views.RobotViews.wrap_rollers`.

    Args:
        spec: Specification of the robot alone; changed in place.
        model: Model compiled from it.
        robot: Indices of the robot in the model.
    """
    removed: list[mujoco.MjsBody] = []
    data = compute_initial_kinematics(model)
    for rim, rollers in zip(robot.rims, robot.rollers, strict=True):
        lumped = rollers[RETAINED_ROLLERS:].tolist()
        mass, center, inertia = compute_composite_inertia(model, [int(rim), *lumped])
        axes = data.xmat[rim].reshape(3, 3)
        set_inertial(
            spec.body(model.body(rim).name),
            mass,
            axes.T @ (center - data.xpos[rim]),
            axes.T @ inertia @ axes,
        )
        removed += [spec.body(model.body(roller).name) for roller in lumped]
    for body in removed:
        spec.delete(body)

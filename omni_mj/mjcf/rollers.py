"""Contacts between rollers and carpet, and wheels that are reduced to two rollers.

**No sliding.** MuJoCo's contacts between rollers and carpet never slide: their friction coefficient
is very high. The creep and sliding of the rubber happen on a hinge between hub and rim
(`omni_mj.robot.wheel_carpet_forces`). Sliding contacts would push the rollers out of the carpet.
In MuJoCo's elliptic cone, the reference acceleration of the tangential directions also acts on the
normal one. At the sliding speed v, a contact approaches the lift mu b_t v / k, with the friction
coefficient mu, and the tangential damping b_t and the normal stiffness k per mass.

**Normal force.** A contact is a spring, a damper, and a mass that keeps it soft enough for the
solver. With the distance r between roller and carpet, negative in contact, the normal force is

    f = -K r - c r' - m r'',    K = 1e5 N/m,  m = 1 kg,  c = 2 zeta sqrt(K (M + m)),  zeta = 0.2

with the robot's mass per wheel M. K and zeta are assumptions, because nobody has measured a carpet.
The robot sinks in by 0.06 mm. MuJoCo's constraint is r'' + R f = -b r' - k r with
R = (1 - d)/d A, where A is the inverse of the effective mass of the two bodies at the contact. It
follows that R = 1/m, k = K/m, b = c/m, d = A/(A + 1/m).

**Friction.** The tangential constraint is a pure damper. When a roller comes down, its speed
approaches that of the carpet with a time constant of 1.7 ms.

**Two rollers per wheel.** One or two rollers of a wheel touch the carpet; the others only carry
mass. `reduce_rollers` keeps two neighbors of each wheel and adds the mass of the others to its rim.
When the wheel has turned by one pitch, the second roller is at the bottom and the first one 2 mm
above the carpet. `omni_mj.plants.mjdata_views.RobotViews.wrap_rollers` then turns the rim back by
one pitch, on the slip hinge, so that hub and encoder do not change. Because rollers are equal, the
first roller takes the place and the spin of the second one. The second roller becomes the next one
to reach the carpet.

Mass matrix. Each removed roller adds its mass, and its inertia by the parallel axis theorem, to the
rim. Rim and remaining rollers together have the mass, center of mass and inertia of the full wheel
at every angle, because equal rollers are symmetric about the axle. Only the spin of the removed
rollers is lost. In a turning robot, their bearings would let them lag behind the chassis; on the
rim they turn with it. That adds at most 0.9e-6 kg m^2 to the chassis's 0.012.

Spin. The next roller starts without spin. A real one arrives with little spin: 14 pitches have
passed since its last contact (55 ms at 100 rad/s), and its bearing slows it down within 15 ms.
Spinning it up takes the impulse I v / q^2, 0.9 g times the sideways speed v, where I is its moment
of inertia and q the distance from its axis to the carpet. This adds to the drag once per pitch.
"""

import math
from typing import Any

import mujoco

from omni_mj.mjcf.robot_geometry import compute_composite_inertia, set_inertial
from omni_mj.mjcf.robot_parts import (
    RETAINED_ROLLERS,
    RobotIndices,
    compute_initial_kinematics,
)

STIFFNESS_N_M = 1e5
ADDED_MASS_KG = 1.0
DAMPING_RATIO = 0.2
FRICTION_RATE_PER_S = 604.8  # inverse of the time constant of friction
FRICTION_STIFFNESS_RATIO = 45.0  # relative to that normal to the carpet: MuJoCo's impratio
STICKING_FRICTION = 5.0  # friction coefficient at which no contact slides


def compute_carpet_damping(wheel_load_kg: float) -> float:
    """Return the damping c of a contact, N s/m, for the mass on its wheel."""
    return 2 * DAMPING_RATIO * math.sqrt(STIFFNESS_N_M * (wheel_load_kg + ADDED_MASS_KG))


def make_roller_contact(
    model: mujoco.MjModel,
    robot: RobotIndices,
    wheel_load_kg: float,
    compliance_ratio: float = 1.0,
    slowdown: float = 1.0,
) -> dict[str, Any]:
    """Return the law of a contact of roller and carpet, with MuJoCo's names of a pair's attributes.

    Args:
        model: Compiled model with the robot.
        robot: Indices of the robot in the model.
        wheel_load_kg: Mass on a wheel.
        compliance_ratio: Factor of R.
        slowdown: Factor by which the contact is slower than K and c: K is divided by its square.
    """
    inverse_mass = float(model.body_invweight0[robot.rollers, 0].max())  # A
    d = inverse_mass / (inverse_mass + compliance_ratio / ADDED_MASS_KG)
    k = STIFFNESS_N_M / ADDED_MASS_KG / slowdown**2
    b = compute_carpet_damping(wheel_load_kg) / ADDED_MASS_KG / slowdown
    return {
        "solref": [-k * d, -b * d],  # MuJoCo divides by d
        "solreffriction": [-1.0, -FRICTION_RATE_PER_S * d],
        "solimp": [d, d, 1.0, 0.5, 2.0],
        "friction": [STICKING_FRICTION, STICKING_FRICTION, 0.005, 0.0001, 0.0001],
    }


def reduce_rollers(spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices) -> None:
    """Keep two rollers per wheel, the one at the bottom and the next; add the others to the rim.

    After each step of the compiled result, call
    `omni_mj.plants.mjdata_views.RobotViews.wrap_rollers`.

    Args:
        spec: Specification of the robot alone; changed in place.
        model: Model compiled from it.
        robot: Indices of the robot in the model.
    """
    data = compute_initial_kinematics(model)
    for rim, rollers in zip(robot.rims, robot.rollers, strict=True):
        removed = rollers[RETAINED_ROLLERS:]
        mass, center, inertia = compute_composite_inertia(model, [rim, *removed])
        axes = data.xmat[rim].reshape(3, 3)  # from the frame of the rim to the world
        set_inertial(
            spec.body(model.body(rim).name),
            mass,
            axes.T @ (center - data.xpos[rim]),
            axes.T @ inertia @ axes,
        )
        for roller in removed:
            spec.delete(spec.body(model.body(roller).name))

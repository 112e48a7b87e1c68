"""What rollers and carpet do to each other, as MuJoCo's contacts.

A contact that slides under MuJoCo's elliptic cone is pushed out of the carpet: the constraint's reference acceleration
of the tangential directions acts on the normal one too, which then seeks a lift of friction x b_t v / k (b_t, k:
tangential damping and normal stiffness per mass), 72 mm at 1.5 m/s with a spring of 50 Hz, half damped, and friction
that acts within 3.5 ms. So these contacts never slide: their friction is out of reach, and what rubber does between
sticking and sliding happens on a hinge between hub and rim (`omni_mj.robot.carpet`). Normal to the carpet a contact is
a spring and a damper, with a mass that keeps it soft enough for the solver,

    f = -K r - c r' - m r'',    K = 1e5 N/m,  m = 1 kg,  c = 2 zeta sqrt(K (M + m)),  zeta = 0.2,

M being a quarter of the robot: assumptions, since nobody measured a carpet; the robot sinks in by 0.06 mm. MuJoCo's
constraint is r'' + R f = -b r' - k r with R = (1 - d)/d A, where A is the inverse of the mass that the two bodies show
the contact, so that R = 1/m, k = K/m, b = c/m, d = A/(A + 1/m). Friction is a damper alone, with the time constant
1.7 ms, in which a roller that comes down takes on the speed of the carpet.
"""

import math
from typing import Any

import mujoco
import numpy as np

STIFFNESS_N_M = 1e5
ADDED_MASS_KG = 1.0
DAMPING_RATIO = 0.2
FRICTION_RATE_HZ = 604.8  # 1/s
FRICTION_STIFFER = 45.0  # than the carpet normal to it: MuJoCo's impratio
NEVER_SLIDES = 5.0
STIFFEST = 0.9999  # the highest impedance d that MuJoCo has


def compute_carpet_damping(wheel_load_kg: float) -> float:
    """Damping of the carpet under a roller, N s/m, for the mass on a wheel."""
    return 2 * DAMPING_RATIO * math.sqrt(STIFFNESS_N_M * (wheel_load_kg + ADDED_MASS_KG))


def make_roller_contact(
    robot: mujoco.MjModel, rollers: np.ndarray, wheel_load_kg: float
) -> dict[str, Any]:
    """Parameters of a pair of carpet and roller, named as MuJoCo names them, of wheels with a slip hinge.

    Args:
        robot: compiled, alone.
        rollers: its bodies.
        wheel_load_kg: mass on a wheel.
    """
    inverse_mass = float(robot.body_invweight0[rollers, 0].max())
    d = inverse_mass / (inverse_mass + 1 / ADDED_MASS_KG)
    k = STIFFNESS_N_M / ADDED_MASS_KG
    b = compute_carpet_damping(wheel_load_kg) / ADDED_MASS_KG
    return {
        "solref": [-k * d, -b * d],  # MuJoCo divides by d
        "solreffriction": [-1.0, -FRICTION_RATE_HZ * d],
        "solimp": [d, d, 1.0, 0.5, 2.0],
        "friction": [NEVER_SLIDES, NEVER_SLIDES, 0.005, 0.0001, 0.0001],
    }

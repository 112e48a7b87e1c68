"""What creep makes of robots' velocities, in closed form, from their numbers.

Wheel i has the direction d_i of its rim and the lever l, a row D_i = (d_i, l) of D; its rim runs by
s_i = |v_i| f_i / (N_i C) faster than the ground passes (`omni_mj.onboard.traction`). Stiff wheel loops let rims
differ from the ground only as a body can move, s = D e, where e = u - v is the twist by the encoders less that of the
body. In translation all |v_i| = |v|, and force and moment of the tractions f_i = N_i C s_i / |v| are

    (F, M) = D^T f = (C / |v|) D^T N D e,        so        e = |v| / C (D^T N D)^-1 (F, M).

Along an axis j of symmetry F = m a + D_j: what speeds the body up, and what drags at it beyond the contacts (pile and
roller bearings; motors and gears act on the hubs). For v > 0

    u = v + T0 v (a + D_j / m),        T0 = m ((D^T N D)^-1)_jj / C,

which is m / (C sum N_i d_ij^2) where other axes do not mix in, and W / (g C sum d_ij^2) for W wheels of equal loads.

**As TIGERs write it,** K u - v = T |u| v'. Comparing what depends on v' and what does not,

    K = 1 / (1 + T0 D_j / m),        T = K T0 v / u = K^2 T0 / (1 + K T0 a).

A fit over a whole move weighs speeding up (a > 0) and braking alike, over which T is K^2 T0 up to (K T0 a)^2, 2 % at
2 m/s^2. Drag shows in the gain K, not in T: without it K were 1.

**Turning** on the spot, wheels travel at l |w|, and with J the yaw inertia and M the drag's moment

    u = w + T0 l |w| (w' + M / J),        T0 = J ((D^T N D)^-1)_ww / C = J / (C l^2 m g),

so that a law with T l |u| in place of T |u| has K = 1 / (1 + T0 l M / J) and again T = K^2 T0.

Loads are those of a body at rest on equal springs, N_i = a + b x_i + c y_i; what shifts in speeding up shifts back in
braking. Left out, with what it changes: bearings' viscous friction and the spinning up of rollers, 0.1 to 0.2 N at
1 m/s, and a rolling radius 0.1 % small (K less by up to 0.014); mass that turns with the rims, 1 to 2 % (T); wheel
loops that are not stiff where loads differ, 3 % (T); and the 1 ms in TIGERs' law, 0.001 s^2/m of T at 1 m/s.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.robot_checks import GRAVITY_M_S2

if TYPE_CHECKING:
    from omni_mj.scenarios.settings import Settings


class Creep(NamedTuple):
    """The law's numbers along forward, sideways and turning, (3,) each.

    Attributes:
        drag: through the contacts, N, N and N m.
        gain, time: K and T as TIGERs fit them, T in s^2/m; without creep 1 and 0.
    """

    drag: Array
    gain: Array
    time: Array


def creep(settings: "Settings") -> Creep:
    """Of a robot on level carpet."""
    wheels, body, creeps = settings.wheels.kinematics, settings.body, settings.wheels.creep == "on"
    load, directions, arm = loads(settings), wheels.matrix, wheels.arm
    inertia = np.array([body.mass_kg, body.mass_kg, body.yaw_inertia_kg_m2])
    bearing = settings.drive.roller_friction * (load[:, None] * np.abs(_axles(wheels.azimuths))).sum(0)
    drag = settings.carpet.pile * load.sum() * np.array([1.0, 1.0, arm]) + np.append(bearing, 0.0)
    softness = np.linalg.inv(directions.T @ (load[:, None] * directions)) / settings.drive.creep_stiffness
    time = inertia * np.diag(softness) * creeps
    gain = 1 / (1 + time * np.array([1.0, 1.0, arm]) * drag / inertia)
    return Creep(drag, gain, gain**2 * time)


def loads(settings: "Settings") -> Array:
    """Of the wheels at rest, (W,) N."""
    wheels, body = settings.wheels.kinematics, settings.body
    places = np.column_stack([np.ones(len(wheels.azimuths)), wheels.arm * _axles(wheels.azimuths)])
    balance = body.mass_kg * GRAVITY_M_S2 * np.array([1.0, body.centre_x_m, 0.0])
    share: Array = places @ np.linalg.solve(places.T @ places, balance)
    return share


def _axles(azimuths: Array) -> Array:
    """Directions of the axles, outward, (W, 2)."""
    return np.stack([np.cos(azimuths), np.sin(azimuths)], axis=-1)

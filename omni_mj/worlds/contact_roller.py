"""A faster wheel of the same physics: one roller a wheel remains, at the carpet, and is handed over as the wheel turns.

Of the rollers of a wheel one or two touch the carpet; the others only carry mass. `reduce` keeps one roller of each
wheel and lumps the others into the hub. `Handover` then turns the wheel back by one pitch P (22.5 degrees with 16
rollers) whenever it is more than half a pitch past zero: the rollers are alike, so that the next one is found where the
last one was. The contact passes along the roller's barrel, and from roller to roller, as on the full wheel.

Mass matrix. A lumped roller of mass m_i at offset r_i and with central inertia I_i (turned into the hub's axes by Q_i)
adds, by the parallel-axis theorem about the common centre of mass c,

    Q_i I_i Q_i' + m_i (|r_i - c|^2 1 - (r_i - c)(r_i - c)').

Hub and kept roller together weigh, balance and turn as the full wheel does, at every angle, for 16 equal rollers look
alike about the axle. Only the lumped rollers' own spin is lost: they turn with the chassis about their axes, where
bearings would have let them lag by I/damping = 15 ms. That adds at most 0.9e-6 kg m^2 to the chassis's 0.012.

The figures below are those of models/ssl_robot.xml.

Contact. A roller whose middle is at an angle d from the lowest point has its lowest point, of a = 22.5 mm, r = 6 mm and
c = 13.077 mm, at the depth h, a distance h' ahead of the axle, and its surface there turns at the radius q about it:

    h(d) = a cos d + s,    h'(d) = (c^2 - r^2) sin d cos d / s - a sin d,    q(d) = r^2 cos d / s,
    s = sqrt(r^2 cos^2 d + c^2 sin^2 d).

Over half a pitch either side, h is 3.8 um below 28.5 mm on average (18 um at the ends) and q 5.83 mm (5.50 mm at the
ends), so that a roller held at d = 0 rolls sideways 3 % too slowly: hence the pitch, not zero, as the step back.

Spin. A roller comes to the carpet with little spin: since it left, 14 pitches have passed (55 ms at 100 rad/s), and its
bearing slows it within 15 ms. Spinning it up takes the impulse I v / q^2 (0.9 g times the sideways speed v), which is a
drag of its own at one roller a pitch, 0.08 N a wheel at 1 m/s and 35 rad/s. So the newcomer is given the speed zero.

What one roller lacks. The carpet yields by 0.10 to 0.15 mm under a wheel at rest, so that on the full wheel a roller
shares the load with its neighbour from d = 3 to 5 degrees on. The newcomer comes down at the speed h' Omega, which the
contact's damping resists: it takes the load over early, lifts the wheel (effective radius 0.19 % below 28.5 mm at
0.25 m/s, 0.11 % at 1 m/s), and carries it up to h'(P/2) = 0.36 mm ahead of the axle, a rolling resistance of 1 to
2 mN m. The one roller has no such resistance, and the radius of a wheel at rest (-0.24 %).
"""

import mujoco
import numpy as np

from omni_control.kinematics import Array
from omni_mj.worlds.columns import Columns
from omni_mj.worlds.roles import Robot


def reduce(spec: mujoco.MjSpec, model: mujoco.MjModel, robot: Robot) -> list[str]:
    """Leave one roller a wheel, the one at the bottom, and make the hubs heavier.

    Every step of what is then compiled must be followed by a call of `Handover`.

    Args:
        spec: of the robot alone; changed.
        model: compiled from it.
        robot: where its parts are in the model.

    Returns:
        Names of the geoms of the rollers left.
    """
    bodies, left, gone = list(spec.bodies), [], []
    for wheel, (kept, *others) in zip(robot.wheels, robot.rollers, strict=True):
        _lump(bodies[wheel], model, others)
        left += [geom.name for geom in bodies[kept].geoms]
        gone += [bodies[roller] for roller in others]
    for roller in gone:
        spec.delete(roller)
    return left


class Handover:
    """The step back of the wheels of n robots, to be called after every step and before anything else reads the state.

    Args:
        wheels: their angles.
        rollers: speeds of the one roller of each wheel.
        pitch: between the rollers of the full wheel, rad.

    Attributes:
        angle: how far each wheel has turned, (n, wheels) rad, full turns counted.
        sensor_offset: what to add to the wheel angles that sensors report, (n, wheels) rad: how far the wheels had been
            turned back before the last step, at whose beginning MuJoCo evaluates its sensors.
    """

    def __init__(self, wheels: Columns, rollers: Columns, pitch: float) -> None:
        self._wheels, self._rollers, self._pitch = wheels, rollers, pitch
        self.angle = np.array(wheels.get())
        self._pitches = np.zeros_like(self.angle)
        self.sensor_offset = np.zeros_like(self.angle)

    def __call__(self) -> None:
        """Turn back the wheels that are past half a pitch; the newcomers do not spin."""
        np.multiply(self._pitches, self._pitch, out=self.sensor_offset)
        past = np.rint(self._wheels.get() * (1 / self._pitch))
        if past.any():
            self._pitches += past
            self._wheels.set(self._wheels.get() - past * self._pitch)
            self._rollers.set(np.where(past != 0, 0.0, self._rollers.get()))
        np.multiply(self._pitches, self._pitch, out=self.angle)
        self.angle += self._wheels.get()


def _lump(hub: mujoco.MjsBody, model: mujoco.MjModel, rollers: list[int]) -> None:
    """Give the hub the mass, centre of mass and inertia of itself and `rollers`."""
    number = hub.id
    mass = model.body_mass[[number, *rollers]]
    at = np.array([model.body_ipos[number], *model.body_pos[rollers]])
    turned = np.array([model.body_iquat[number], *(_product(model, b) for b in rollers)])
    centre = mass @ at / mass.sum()
    inertia = np.zeros((3, 3))
    for m, r, q, own in zip(mass, at - centre, turned, model.body_inertia[[number, *rollers]], strict=True):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, q)
        axes = rotation.reshape(3, 3)
        inertia += axes @ np.diag(own) @ axes.T + m * (r @ r * np.eye(3) - np.outer(r, r))
    hub.mass, hub.ipos, hub.iquat = mass.sum(), centre, [1.0, 0.0, 0.0, 0.0]
    hub.inertia = np.zeros(3)  # the compiler takes either this or the full matrix
    hub.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _product(model: mujoco.MjModel, body: int) -> Array:
    """Orientation of a body's principal axes in its parent."""
    result = np.zeros(4)
    mujoco.mju_mulQuat(result, model.body_quat[body], model.body_iquat[body])
    return result

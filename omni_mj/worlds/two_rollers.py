"""A faster wheel of the same physics: two rollers a wheel remain, those that flank the bottom.

Of the rollers of a wheel one or two touch the carpet; the others only carry mass. `reduce` keeps two neighbours of each
wheel and lumps the others into its rim. `Handover` turns the rim back by one pitch whenever one of the two has come to
the bottom and the other is a full pitch away: the rollers are alike, so that the one at the bottom is found where the
other was, with its spin, and what was a pitch away, 2 mm above the carpet, is the newcomer. Hub and encoder do not
know: what is turned back is the slip hinge.

Mass matrix. A lumped roller adds its mass, and its inertia by the parallel-axis theorem, to the rim. Rim and kept
rollers together weigh, balance and turn as the full wheel does, at every angle, for equal rollers look alike about the
axle. Only the lumped rollers' own spin is lost: they turn with the chassis about their axes, where bearings would have
let them lag. That adds at most 0.9e-6 kg m^2 to the chassis's 0.012.

Spin. A roller comes to the carpet with little of it: since it left, 14 pitches have passed (55 ms at 100 rad/s), and
its bearing slows it within 15 ms. Spinning it up takes the impulse I v / q^2 (0.9 g times the sideways speed v; q is
the radius at which it turns), a drag of its own at one roller a pitch. So the newcomer does not spin.
"""

import mujoco
import numpy as np

from omni_mj.mjcf.geometry import composite, weigh
from omni_mj.mjcf.roles import KEPT, Robot
from omni_mj.worlds.columns import Columns


def reduce(spec: mujoco.MjSpec, model: mujoco.MjModel, robot: Robot) -> None:
    """Leave two rollers a wheel, the one at the bottom and the next to come there, and make the rims heavier.

    Every step of what is then compiled must be followed by a call of `Handover`.

    Args:
        spec: of the robot alone; changed.
        model: compiled from it.
        robot: where its parts are in the model.
    """
    gone: list[mujoco.MjsBody] = []
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for rim, rollers in zip(robot.rims, robot.rollers, strict=True):
        others = rollers[KEPT:].tolist()
        mass, centre, inertia = composite(model, [int(rim), *others])
        axes = data.xmat[rim].reshape(3, 3)
        weigh(spec.body(model.body(rim).name), mass, axes.T @ (centre - data.xpos[rim]), axes.T @ inertia @ axes)
        gone += [spec.body(model.body(roller).name) for roller in others]
    for roller in gone:
        spec.delete(roller)


class Handover:
    """The step back of the rims of n robots, to be called after every step and before anything else reads the state.

    Args:
        hubs: angles of the hubs.
        slips: angles of the rims on them.
        spins: speeds of the two rollers of each wheel, those at the bottom first, then the next ones.
        pitch: between the rollers of the full wheel, rad.
    """

    def __init__(self, hubs: Columns, slips: Columns, spins: tuple[Columns, Columns], pitch: float) -> None:
        self._hubs, self._slips, self._spins, self._pitch = hubs, slips, spins, pitch

    def __call__(self) -> None:
        """Turn back the rims that are past a pitch, or before the bottom one."""
        slips = self._slips.get()
        past = np.floor((self._hubs.get() + slips) * (1 / self._pitch))
        if past.any():
            self._slips.set(slips - past * self._pitch)
            bottom, following = (spins.get().copy() for spins in self._spins)
            self._spins[0].set(np.where(past == 0, bottom, np.where(past == 1, following, 0.0)))
            self._spins[1].set(np.where(past == 0, following, np.where(past == -1, bottom, 0.0)))

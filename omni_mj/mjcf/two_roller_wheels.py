"""A faster wheel of the same physics: two rollers a wheel remain, those that flank the bottom.

Of the rollers of a wheel one or two touch the carpet; the others only carry mass. `reduce` keeps two neighbours of each
wheel and lumps the others into its rim. `omni_mj.plants.mjdata_views.RobotViews.wrap_rollers` turns the rim back by one pitch
whenever one of the two has come to the bottom and the other is a full pitch away: the rollers are alike, so that the
one at the bottom is found where the other was, with its spin, and what was a pitch away, 2 mm above the carpet, is the
newcomer. Hub and encoder do not know: what is turned back is the slip hinge.

Mass matrix. A lumped roller adds its mass, and its inertia by the parallel-axis theorem, to the rim. Rim and kept
rollers together weigh, balance and turn as the full wheel does, at every angle, for equal rollers look alike about the
axle. Only the lumped rollers' own spin is lost: they turn with the chassis about their axes, where bearings would have
let them lag. That adds at most 0.9e-6 kg m^2 to the chassis's 0.012.

Spin. A roller comes to the carpet with little of it: since it left, 14 pitches have passed (55 ms at 100 rad/s), and
its bearing slows it within 15 ms. Spinning it up takes the impulse I v / q^2 (0.9 g times the sideways speed v; q is
the radius at which it turns), a drag of its own at one roller a pitch. So the newcomer does not spin.
"""

import mujoco

from omni_mj.mjcf.robot_geometry import compute_composite_inertia, set_inertial
from omni_mj.mjcf.robot_indices import RETAINED_ROLLERS, RobotIndices


def reduce(spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices) -> None:
    """Leave two rollers a wheel, the one at the bottom and the next to come there, and make the rims heavier.

    Every step of what is then compiled must be followed by
    `omni_mj.plants.mjdata_views.RobotViews.wrap_rollers`.

    Args:
        spec: of the robot alone; changed.
        model: compiled from it.
        robot: where its parts are in the model.
    """
    gone: list[mujoco.MjsBody] = []
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for rim, rollers in zip(robot.rims, robot.rollers, strict=True):
        others = rollers[RETAINED_ROLLERS:].tolist()
        mass, centre, inertia = compute_composite_inertia(model, [int(rim), *others])
        axes = data.xmat[rim].reshape(3, 3)
        set_inertial(
            spec.body(model.body(rim).name),
            mass,
            axes.T @ (centre - data.xpos[rim]),
            axes.T @ inertia @ axes,
        )
        gone += [spec.body(model.body(roller).name) for roller in others]
    for roller in gone:
        spec.delete(roller)

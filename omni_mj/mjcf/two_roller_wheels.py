"""Faster wheels with the same physics: each wheel keeps only the two rollers next to the bottom.

One or two rollers of a wheel touch the carpet; the others only carry mass. `reduce_rollers` keeps
two neighbors of each wheel and adds the mass of the others to its rim. When one of the two has
reached the bottom and the other is a full pitch away,
`omni_mj.plants.mjdata_views.RobotViews.wrap_rollers` turns the rim back by one pitch. The rollers
are equal: the second roller takes the place and the spin of the one at the bottom. The first one,
then 2 mm above the carpet, becomes the next roller. Hub and encoder do not change, because only the
slip hinge is turned back.

Mass matrix. A lumped roller adds its mass, and its inertia by the parallel axis theorem, to the
rim. Rim and remaining rollers together have the mass, center of mass and inertia of the full wheel
at every angle, because equal rollers are symmetric about the axle. Only the spin of the lumped
rollers is lost: they turn with the chassis about their axes, where their bearings would let them
lag behind. That adds at most 0.9e-6 kg m^2 to the chassis's 0.012.

Spin. A roller reaches the carpet with little spin: since its last contact 14 pitches have passed
(55 ms at 100 rad/s), and its bearing slows it down within 15 ms. Spinning it up takes the impulse
I v / q^2, 0.9 g times the sideways speed v, where q is its radius of rotation. This is a further
drag, of one roller per pitch. The next roller therefore starts without spin.
"""

import mujoco

from omni_mj.mjcf.model_measurements import compute_composite_inertia, set_inertial
from omni_mj.mjcf.part_recognition import RETAINED_ROLLERS, RobotIndices


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
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
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

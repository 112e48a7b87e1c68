"""Changes of a user's MJCF that fit its robot into a world; `custom_robot_file` lists them."""

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.model_measurements import WheelGeometry
from omni_mj.mjcf.part_recognition import (
    HINGE,
    RobotIndices,
    compute_initial_kinematics,
    find_slip_hinges,
)

# Solver parameters of the friction of hinges, same as in models/ssl_robot.xml.
HINGE_FRICTION = {
    "solimp_friction": [0.999, 0.9999, 0.001, 0.5, 2.0],
    "solref_friction": [0.005, 1.0],
}
# Attributes of a body that list its children with a position.
_CHILD_LISTS = ("bodies", "geoms", "sites", "cameras", "lights")


def name_elements(spec: mujoco.MjSpec) -> None:
    """Name unnamed bodies, joints and geoms, and delete keyframes, whose world differs."""
    for key in list(spec.keys):
        spec.delete(key)
    spec.nkey = mujoco.MjSpec().nkey
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("geom", spec.geoms)):
        for number, element in enumerate(elements):
            element.name = element.name or f"unnamed_{kind}_{number}"


def remove_surroundings(spec: mujoco.MjSpec, chassis: mujoco.MjsBody) -> None:
    """Delete everything outside the robot, contact pairs, and contact sensors."""
    world = spec.worldbody
    elements: list[object] = [body for body in world.bodies if body.name != chassis.name]
    elements += [*world.geoms, *world.lights, *world.cameras, *world.sites, *spec.pairs]
    for element in elements:
        spec.delete(element)
    contact = mujoco.mjtSensor.mjSENS_CONTACT
    for sensor in [sensor for sensor in spec.sensors if sensor.type == contact]:
        spec.delete(sensor)


def place_at_origin(chassis: mujoco.MjsBody) -> None:
    """Put the chassis at the world's origin, with its axes along the world's."""
    chassis.set_frame(chassis.parent.add_frame())
    chassis.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    chassis.pos, chassis.quat = np.zeros(3), [1.0, 0.0, 0.0, 0.0]


def disable_contacts(
    spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices
) -> tuple[str, ...]:
    """Switch off the contacts of all geoms; return the rollers' geoms that touch the carpet.

    Of each roller these are the geoms that could collide in the file, or all if none could.

    Raises:
        OmniError: A roller has no geom.
    """
    colliding = {geom.name for geom in spec.geoms if geom.contype or geom.conaffinity}
    contact_geoms: list[str] = []
    for roller in robot.rollers.ravel():
        geoms = [model.geom(i).name for i in np.flatnonzero(model.geom_bodyid == roller)]
        if not geoms:
            raise OmniError(
                f"the roller {model.body(roller).name!r} has no geom that could touch the carpet"
            )
        contact_geoms += [name for name in geoms if name in colliding] or geoms
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    return tuple(contact_geoms)


def prepare_hinges(
    spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices, wheels: WheelGeometry
) -> None:
    """Orient the hinges of wheels, add missing slip hinges, and set the friction of hinges.

    Afterwards the axes of all wheel and slip hinges point to the robot's center.
    """
    data = compute_initial_kinematics(model)
    for joint, rim, phase, is_outward in zip(
        robot.joints, robot.rims, robot.phases, wheels.is_outward, strict=True
    ):
        hub = spec.joint(model.joint(joint).name)
        slip_hinges = find_slip_hinges(model, int(joint), int(rim))
        has_hub_direction, initial_slip = True, 0.0
        if slip_hinges:
            slip = spec.joint(model.joint(slip_hinges[0]).name)
            has_hub_direction = data.xaxis[joint] @ data.xaxis[slip_hinges[0]] > 0
            initial_slip = model.qpos0[model.jnt_qposadr[slip_hinges[0]]]
        else:
            body = spec.body(model.body(rim).name)
            slip = body.add_joint(name=f"slip_of_{hub.name}", type=HINGE, armature=0.0)
            slip.pos, slip.axis = _get_hinge_in_body_frame(data, int(rim), int(joint))
        if is_outward:
            hub.axis = -np.array(hub.axis)
        if is_outward == has_hub_direction:
            slip.axis = -np.array(slip.axis)
        reference = (phase - initial_slip) if is_outward else (initial_slip - phase)
        slip.ref = np.degrees(reference) if spec.compiler.degree else reference
        for name, value in HINGE_FRICTION.items():
            setattr(hub, name, value)
            setattr(slip, name, value)
        slip.damping = np.zeros_like(slip.damping)
    for address in robot.roller_dofs.ravel():  # the plant sets the friction of their bearings
        spec.joint(model.joint(model.dof_jntid[address]).name).frictionloss = 0.0


def _get_hinge_in_body_frame(data: mujoco.MjData, body: int, joint: int) -> tuple[Array, Array]:
    """Return anchor and axis, (3,) each, of a hinge in the frame of a body that it carries."""
    axes = data.xmat[body].reshape(3, 3)
    return axes.T @ (data.xanchor[joint] - data.xpos[body]), axes.T @ data.xaxis[joint]


def raise_parts(chassis: mujoco.MjsBody, height: float) -> None:
    """Raise all parts in the frame of the chassis by a height, m."""
    if abs(height) < 1e-9:
        return
    shift = np.array([0.0, 0.0, height])
    frames = list(chassis.frames)
    children = [child for attribute in _CHILD_LISTS for child in getattr(chassis, attribute)]
    for element in [*frames, *children]:
        if element.frame is None:
            element.pos = np.array(element.pos) + shift
    if chassis.explicitinertial:
        chassis.ipos = np.array(chassis.ipos) + shift

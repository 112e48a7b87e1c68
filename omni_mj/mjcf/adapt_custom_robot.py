"""Changes a user's model so that it fits into a world; see `own` for what and why."""

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.mjcf.robot_geometry import WheelGeometry
from omni_mj.mjcf.robot_indices import HINGE, RobotIndices, find_slip_hinges

# Friction of hinges, as in models/ssl_robot.xml.
STIFF = {"solimp_friction": [0.999, 0.9999, 0.001, 0.5, 2.0], "solref_friction": [0.005, 1.0]}
PLACED = ("bodies", "geoms", "sites", "cameras", "lights")  # kinds of what a body carries


def name_all(spec: mujoco.MjSpec) -> None:
    """Give names to bodies, joints and geoms that have none, and forget keyframes, which are of another world."""
    for key in list(spec.keys):
        spec.delete(key)
    spec.nkey = mujoco.MjSpec().nkey
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("geom", spec.geoms)):
        for number, element in enumerate(elements):
            element.name = element.name or f"unnamed_{kind}_{number}"


def isolate(spec: mujoco.MjSpec, chassis: mujoco.MjsBody) -> None:
    """Leave the robot alone: no carpet, light or second robot, and nothing that touches by itself."""
    world = spec.worldbody
    others: list[object] = [body for body in world.bodies if body.name != chassis.name]
    others += [*world.geoms, *world.lights, *world.cameras, *world.sites, *spec.pairs]
    for element in others:
        spec.delete(element)
    for sensor in [
        sensor for sensor in spec.sensors if sensor.type == mujoco.mjtSensor.mjSENS_CONTACT
    ]:
        spec.delete(sensor)  # of what is not there any more


def stand(chassis: mujoco.MjsBody) -> None:
    """Put the chassis at the world's origin, its axes along the world's."""
    chassis.set_frame(chassis.parent.add_frame())
    chassis.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    chassis.pos, chassis.quat = np.zeros(3), [1.0, 0.0, 0.0, 0.0]


def touching(spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices) -> tuple[str, ...]:
    """Names of the rollers' geoms that touch: of each those that collide, or all if none does; none does from here."""
    collides = {geom.name for geom in spec.geoms if geom.contype or geom.conaffinity}
    touching: list[str] = []
    for roller in robot.rollers.ravel():
        geoms = [model.geom(i).name for i in np.flatnonzero(model.geom_bodyid == roller)]
        if not geoms:
            raise OmniError(
                f"the roller {model.body(roller).name!r} has no geom that could touch the carpet"
            )
        touching += [name for name in geoms if name in collides] or geoms
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    return tuple(touching)


def drive(
    spec: mujoco.MjSpec, model: mujoco.MjModel, robot: RobotIndices, wheels: WheelGeometry
) -> None:
    """Make hinges of wheels turn the way that the program reckons with, and rims slip on them."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for joint, rim, phase, outward in zip(
        robot.joints, robot.rims, robot.phases, wheels.outward, strict=True
    ):
        hub = spec.joint(model.joint(joint).name)
        body = spec.body(model.body(rim).name)
        slips = find_slip_hinges(model, int(joint), int(rim))
        if slips:
            slip = spec.joint(model.joint(slips[0]).name)
        else:
            slip = body.add_joint(name=f"slip_of_{hub.name}", type=HINGE, armature=0.0)
            slip.pos, slip.axis = seen_from(model, int(rim), int(joint))
        if outward:
            hub.axis = -np.array(hub.axis)
        # Axes of hub and rim, as in the file
        same = data.xaxis[joint] @ data.xaxis[slips[0]] > 0 if slips else True
        if outward == same:
            slip.axis = -np.array(slip.axis)
        before = model.qpos0[model.jnt_qposadr[slips[0]]] if slips else 0.0
        first = (phase - before) if outward else (before - phase)
        slip.ref = np.degrees(first) if spec.compiler.degree else first
        for name, value in STIFF.items():
            setattr(hub, name, value)
            setattr(slip, name, value)
        slip.damping = np.zeros_like(slip.damping)
    for address in robot.roller_dofs.ravel():  # what their bearings lose is the robot's file's
        spec.joint(model.joint(model.dof_jntid[address]).name).frictionloss = 0.0


def seen_from(model: mujoco.MjModel, rim: int, joint: int) -> tuple[Array, Array]:
    """Anchor and axis of a hinge in the frame of a body below it, (3,) each."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = data.xmat[rim].reshape(3, 3)
    return axes.T @ (data.xanchor[joint] - data.xpos[rim]), axes.T @ data.xaxis[joint]


def lower(chassis: mujoco.MjsBody, by: float) -> None:
    """Shift all that is on the chassis up by this, so that its frame is on the carpet, m."""
    if abs(by) < 1e-9:
        return
    shift = np.array([0.0, 0.0, by])
    frames = list(chassis.frames)
    inside = [element for kind in PLACED for element in getattr(chassis, kind)]
    for element in [*frames, *inside]:
        if element.frame is None:
            element.pos = np.array(element.pos) + shift
    if chassis.explicitinertial:
        chassis.ipos = np.array(chassis.ipos) + shift

"""Contacts of robots that are attached to a user's scene, with any floor and solver options.

**What collides.** The geoms of a scene usually have the bit 1 of contype and conaffinity. Wheels
and hulls collide with geoms with any of the low bits, but wheels not with hulls. A hull of upright
cylinders collides with other robots by its spheres, for the reason in `omni_mj.mjcf.hulls`.

**Wheels on the floor** never slide, as on the field: rubber creeps and slides on the hinge between
hub and rim. Normal to the floor, a contact has the law of `omni_mj.mjcf.rollers`, with K, c and m.
Along the floor, MuJoCo has the same rate c / m, as friction has a rate of its own in contact pairs
only. So the traction F makes contacts creep, in addition to the rubber. In elliptic cones it is by
F / (i c), with the impratio i. Most scenes have pyramidal cones. There, at the coefficient of
friction mu, MuJoCo regularizes an edge of the pyramid by

    R = 2 mu^2 / i (1 - d) / d A (1 + mu^2)

with the inverse effective mass A. Four edges share the normal force, so the added mass is
m = 4 / R, from which d follows: (1 - d) / d is that of the field times 2 i / (mu^2 (1 + mu^2)).
The creep is R F / (2 mu^2 c / m) = 2 F / (mu^2 c), 1 mm/s at 2 N.

Steps longer than 2 ms need softer contacts: K and c fall so that K dt^2 and c dt stay the same.
"""

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_mj.mjcf import hulls, rollers
from omni_mj.mjcf.attachable_robot import (
    AttachableRobot,
    attach_with_contact_pairs,
    attach_without_contacts,
)
from omni_mj.mjcf.robot_geometry import make_printable_moments
from omni_mj.mjcf.robot_parts import RobotIndices, find_roller_geoms

MAX_TIMESTEP_S = 0.005  # longest step with which robots were compared to the plant
NOMINAL_TIMESTEP_S = 0.002  # longest step at which contacts are as stiff as K and c

# Bits of contype and conaffinity
_SCENE = (1 << 29) - 1  # geoms of scenes
_SPHERE = 1 << 29  # spheres of hulls
_HULL = 1 << 30  # hulls that are no upright cylinders
# Forces without which no wheel rolls, by MuJoCo's names of the flags that disable them
_NEEDED_FORCES = ("CONSTRAINT", "FRICTIONLOSS", "CONTACT", "ACTUATION", "SENSOR", "GRAVITY")


def is_field(scene: mujoco.MjSpec) -> bool:
    """Return whether a scene is models/field.xml, on which robots have the contacts of plants."""
    carpet = scene.geom(hulls.CARPET)
    return (
        carpet is not None
        and carpet.classname.name == "solid"
        and scene.option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
        and scene.option.impratio == rollers.FRICTION_STIFFNESS_RATIO
    )


def attach_with_scene_contacts(
    scene: mujoco.MjSpec, robot: AttachableRobot, prefix: str, frame: mujoco.MjsFrame
) -> None:
    """Attach a robot to any scene. It collides with every geom of the scene that can collide.

    Args:
        scene: Specification of the scene; changed in place.
        robot: The robot.
        prefix: Prefix of the robot's names.
        frame: Frame of the robot.
    """
    on_field = is_field(scene)
    _enable_contacts(robot, on_field)
    if not on_field:
        for rim in robot.rims:
            body = robot.spec.body(rim)
            body.inertia = make_printable_moments(body.inertia)
        attach_without_contacts(scene, robot, prefix, frame)
        return
    other_spheres = [g.name for g in scene.geoms if g.name.endswith(hulls.SPHERE_SUFFIX)]
    attach_with_contact_pairs(scene, robot, prefix, other_spheres, frame)
    # With the geoms of the field there are contact pairs only.
    for body in (robot.chassis, *(robot.spec.geom(g).parent.name for g in robot.contact_geoms)):
        scene.add_exclude(bodyname1="world", bodyname2=prefix + body)


def _enable_contacts(robot: AttachableRobot, on_field: bool) -> None:
    """Set the bits of contype and conaffinity of a robot's geoms."""
    spec = robot.spec
    for name in robot.contact_geoms:
        roller = spec.geom(name)
        roller.contype, roller.conaffinity = 0, _SCENE
        roller.condim, roller.priority = 3, 100
        roller.friction = [rollers.STICKING_FRICTION, 0.005, 0.0001]
    for name in robot.hull_geoms:
        hull = spec.geom(name)
        hull.contype = 0 if robot.hull_spheres else _HULL
        hull.conaffinity = _SCENE | _HULL
    if not on_field:  # there, spheres have pairs
        for name in robot.hull_spheres:
            sphere, hull = spec.geom(name), spec.geom(name.removesuffix(hulls.SPHERE_SUFFIX))
            sphere.contype = sphere.conaffinity = _SPHERE
            sphere.priority, sphere.solref = hull.priority, hull.solref


def set_floor_contacts(model: mujoco.MjModel, robot: RobotIndices, wheel_load_kg: float) -> None:
    """Set the law of a robot's contacts with the floor, for the solver options of the scene.

    Args:
        model: Model of the scene; changed in place.
        robot: Indices of the robot.
        wheel_load_kg: Mass on a wheel.
    """
    compliance_ratio = 1.0
    if model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL:
        square = rollers.STICKING_FRICTION**2
        compliance_ratio = 2 * model.opt.impratio / (square * (1 + square))
    slowdown = max(model.opt.timestep / NOMINAL_TIMESTEP_S, 1.0)
    law = rollers.make_roller_contact(model, robot, wheel_load_kg, compliance_ratio, slowdown)
    geoms = find_roller_geoms(model, robot)
    model.geom_solref[geoms], model.geom_solimp[geoms] = law["solref"], law["solimp"]


def check_scene(model: mujoco.MjModel, robot: RobotIndices) -> None:
    """Check that the wheels of a robot can roll in a scene.

    Args:
        model: Model of the scene.
        robot: Indices of the robot.

    Raises:
        OmniError: No geom can touch the wheels, the timestep is too long, or the scene's options
            disable forces that wheels need.
    """
    step = model.opt.timestep
    has_pairs = bool(np.isin(model.pair_geom2, find_roller_geoms(model, robot)).any())
    max_step = NOMINAL_TIMESTEP_S if has_pairs else MAX_TIMESTEP_S
    if step > max_step:
        raise OmniError(
            f"the timestep of the {'field' if has_pairs else 'scene'} is {step:g} s; wheels need "
            f"at most {max_step:g} s"
        )
    if model.opt.gravity[2] >= 0:
        raise OmniError("gravity must have a component downward, along -z: wheels stand by it")
    disabled = [
        name
        for name in _NEEDED_FORCES
        if model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}")
    ]
    if disabled:
        names = ", ".join(disabled).lower()
        raise OmniError(f"the options of the scene disable {names}, without which no wheel rolls")
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        raise OmniError("the options of the scene override all contacts, also those of wheels")
    is_outside = model.body_rootid[model.geom_bodyid] != robot.chassis
    if not (has_pairs or (model.geom_contype[is_outside] & _SCENE).any()):
        raise OmniError(
            f"nothing in the scene can touch the wheels of {model.body(robot.chassis).name!r}: it "
            'needs a floor, with contype="1"'
        )

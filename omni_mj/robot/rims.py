"""What happens between physics steps of the plant `mujoco`: what robots carry, drag, and the limits of slip hinges."""

from typing import NamedTuple, Self

import numpy as np

from omni_mj.robot.array_namespace import Array, any_true, namespace, rotate, select
from omni_mj.robot.carpet import (
    DRAG_CYCLES,
    CarpetParameters,
    Drag,
    Motion,
    compute_drag,
    limit_torque,
)
from omni_mj.robot.onboard import (
    CycleRecord,
    FrameInputs,
    OnboardParameters,
    OnboardState,
    begin_frame,
    end_frame,
    hear,
    run_cycle,
)
from omni_mj.robot.wheel_loops import Command


class MujocoParameters(NamedTuple):
    """Parameters of n robots on the plant `mujoco`."""

    onboard: OnboardParameters
    carpet: CarpetParameters
    centre: Array  # of mass of the chassis, from the middle of the wheels' contacts, (3, n) m


class Sensed(NamedTuple):
    """What is read of robots before a step, (n,) unless another shape is given."""

    gyro: Array  # turn rate that gyros showed a cycle ago, rad/s
    encoder_angle: Array  # of wheels, a cycle ago, (W, n) rad
    wheel_speed: Array  # of hubs, (W, n) rad/s
    load: Array  # of wheels, (W, n) N
    x: Array  # m
    y: Array
    quaternion_w: Array
    quaternion_z: Array
    velocity_x: Array  # world frame, m/s
    velocity_y: Array
    turn_rate: Array  # rad/s


class Drives(NamedTuple):
    """What is written before a step, (W, n) unless another shape is given."""

    voltage: Array  # for MuJoCo's dcmotors, V
    limit: Array  # greatest torque of the slip hinges, N m
    impedance: Array  # of their friction
    wrench: Array  # of drag and pushes on the chassis, world frame, (6, n) N and N m
    softness: Array  # see `Drag`
    rim_friction: Array
    record: CycleRecord


class MujocoState(NamedTuple):
    """State of n robots on the plant `mujoco`, beside MuJoCo's own."""

    onboard: OnboardState
    drag: Drag
    wrench: Array  # of drag and pushes, (6, n) N and N m

    @classmethod
    def at_rest(
        cls, onboard: tuple[OnboardParameters, OnboardState], carpet: CarpetParameters, sensed: tuple[Array, Array]
    ) -> Self:
        """Return the state of robots that are switched on, whose gyros and encoders show what was `sensed`."""
        (p, s), (gyro, angle) = onboard, sensed
        still, wheels = np.zeros_like(gyro), np.zeros_like(angle)
        loops = s.loops._replace(last_count=np.floor(angle * p.loops.counts_per_rad))
        drag = Drag(still, still, still, wheels, wheels, wheels)
        return cls(s._replace(loops=loops), drag, np.zeros((6, len(gyro))))


def accept(p: MujocoParameters, s: MujocoState, command: Command) -> tuple[MujocoState, None]:
    """Take over a command from the next cycle on."""
    return s._replace(onboard=hear(p.onboard, s.onboard, command)), None


def start_frame(
    p: MujocoParameters, s: MujocoState, inputs: FrameInputs, encoder_angle: Array
) -> tuple[MujocoState, tuple[Array, Array]]:
    """Begin a frame.

    Args:
        p: Parameters.
        s: State.
        inputs: What acts in the frame.
        encoder_angle: As sensed last, (W, n) rad.

    Returns:
        The state, and resistance and torque constant of the motors in this frame, (W, n) ohm and N m/A.
    """
    s = s._replace(onboard=begin_frame(p.onboard, s.onboard, inputs, encoder_angle))
    motors = s.onboard.motors
    return s, (motors.resistance, motors.back_emf / p.onboard.motors.gear)


def finish_frame(p: MujocoParameters, s: MujocoState, record: CycleRecord) -> tuple[MujocoState, None]:
    """End a frame by the records of its cycles."""
    return s._replace(onboard=end_frame(p.onboard, s.onboard, record)), None


def drive_cycle(p: MujocoParameters, s: MujocoState, sensed: Sensed) -> tuple[MujocoState, Drives]:
    """Turn what is sensed into voltages, forces on the chassis, and limits of the slip hinges."""
    cycle = s.onboard.cycle
    onboard, record = run_cycle(p.onboard, s.onboard, sensed.gyro, sensed.encoder_angle, sensed.wheel_speed)
    is_due = cycle % DRAG_CYCLES == 0
    drag, wrench = s.drag, s.wrench
    if any_true(is_due):
        motion = _motion(sensed)
        new = compute_drag(p.carpet, motion, sensed.load, sensed.encoder_angle)
        drag = select(is_due, new, s.drag)
        wrench = select(is_due, _wrench(p.centre, onboard.inputs, motion, new), s.wrench)
    limit, stiffness = impedance(drag.rim_friction, drag.softness, sensed.load)
    motors = onboard.motors
    # MuJoCo's dcmotor knows a constant R in place of R + X |w|.
    voltage = motors.back_emf * sensed.wheel_speed + record.current * motors.resistance
    drives = Drives(voltage, limit, stiffness, wrench, drag.softness, drag.rim_friction, record)
    return MujocoState(onboard, drag, wrench), drives


def impedance(rim_friction: Array, softness: Array, load: Array) -> tuple[Array, Array]:
    """Return limit (W, n), N m, and impedance of slip hinges under a load (W, n) in N; see `omni_mj.robot.carpet`."""
    limit, pressed = limit_torque(rim_friction, load)
    return limit, pressed / (pressed + softness)


def _motion(sensed: Sensed) -> Motion:
    """Return the motion of robots that stand upright."""
    w, z = sensed.quaternion_w, sensed.quaternion_z
    cosine, sine = w * w - z * z, 2 * w * z
    ahead, aside = rotate(sensed.velocity_x, sensed.velocity_y, cosine, -sine)
    return Motion(sensed.x, sensed.y, cosine, sine, ahead, aside, sensed.turn_rate)


def _wrench(centre: Array, inputs: FrameInputs, motion: Motion, drag: Drag) -> Array:
    xp = namespace(motion.x)
    x, y = rotate(drag.ahead, drag.aside, motion.cosine, motion.sine)
    centre_x, centre_y, height = centre
    moment = drag.moment - centre_x * drag.aside + centre_y * drag.ahead
    zero = moment * 0.0
    return xp.stack([x + inputs.push_x, y + inputs.push_y, zero, height * y, -height * x, moment])

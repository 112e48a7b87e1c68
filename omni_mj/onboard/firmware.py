"""What runs on the robot: from a received velocity to the motors' duties, up to 960 times a second."""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.link.radio import Received
from omni_mj.onboard import arrays, laws
from omni_mj.onboard.arrays import FirmwareArrays
from omni_mj.onboard.heading import HeadingEstimate
from omni_mj.onboard.motor import Motor
from omni_mj.scenarios.settings import Settings, column

DERATED = 2.0  # nominal currents; allowed at the beginning of derating, none at the limit


class Firmware:
    """Inverse kinematics by the estimated heading, a turn-rate loop on the gyro, and one PID loop per wheel.

    The loops reckon in volts of a nominal battery and command duties, so that a low battery weakens them; of the motors
    they know the datasheet, by which they feed the back-EMF forward. Loops slower than the calls look at sensors and
    reckon in every k-th call only, and hold their duties between (`firmware.rate_hz`).

    Velocities are the world's, and are turned to the robot by its own heading; or the robot's own (`Received.body`).
    Rim speeds (`Received.wheels`) bypass kinematics and turn-rate loop. A robot whose radio brings nothing new for
    `firmware.timeout_s` stands until it does: its wheels are held at rest.

    Args:
        settings: one per robot.
        kinematics: of the robot's wheels.
        heading: at the start, (n,) rad.
        timestep: time between calls of `duties`, s.
        period: time between calls of `receive`, s.

    Attributes:
        cycle: calls of `duties` so far; a compiled loop counts what it does in their place.
        block: state and numbers (see `arrays.firmware`).
    """

    def __init__(
        self,
        settings: Sequence[Settings],
        kinematics: Kinematics,
        heading: Array,
        timestep: float,
        period: float,
    ) -> None:
        n, wheels, firmware = len(settings), len(kinematics.azimuths), [s.firmware for s in settings]
        motors = [Motor.of(s.motor) for s in settings]
        self.block = np.zeros((arrays.FIRMWARE_ROBOTS, n)), np.zeros((arrays.FIRMWARE_WHEELS, wheels, n))
        self._f = f = arrays.firmware(*self.block)
        self.estimate = HeadingEstimate(settings, heading, period, (f.heading, f.bias, f.heading_share, f.bias_share))
        self._speed_constant = column(motors, "speed_constant")
        # Calls from one run of each robot's loops to the next; those of tests may be further apart than the loops'.
        self._every = np.maximum(1.0, np.rint(1 / (column(firmware, "rate_hz") * timestep)))
        self._timestep = self._every * timestep
        self._each = self._timestep[:, 0]
        self._slow, self._held = bool((self._every > 1).any()), f.held.T
        self._gated = self._slow  # whether some robots' loops do not run in every call
        f.forward[:], f.left[:], f.turn[:] = (kinematics.matrix.T / kinematics.radius)[..., None]
        self._radius = kinematics.radius
        self._kp, self._ki, self._kd = (column(firmware, name) for name in ("kp", "ki", "kd"))
        self._integrates = bool(self._ki.any() or self._kd.any())
        self._back_emf = column(firmware, "feed_forward") * self._speed_constant
        self._nominal = column(firmware, "nominal_voltage_v")
        f.turn_gain[:] = column(firmware, "turn_gain")[:, 0]
        derates, thermal = column(firmware, "derate")[:, 0].astype(bool), [s.motor for s in settings]
        self._derates = bool(derates.any())
        f.hot[:] = np.where(derates, column(thermal, "limit_c")[:, 0], np.inf)
        f.derated[:] = DERATED * column(thermal, "nominal_current_a")[:, 0]
        f.resistance[:] = column(motors, "resistance")[:, 0]
        self._swing: Array | None = None
        f.swing[:], f.rims[:], f.gyro_scale[:], f.count_scale[:] = np.inf, np.nan, 1.0, 1.0
        self._count_scale, self._count_shift = f.count_scale.T, f.count_shift.T
        self._misled = False  # whether sensors show anything but what there is
        self._deaf, self._lost, self._heeds = np.zeros(n, bool), np.zeros(n, bool), True
        counts = column([s.sensors for s in settings], "encoder_counts") * column(motors, "gear") / (2 * np.pi)
        self._counts_per_rad, self._rate_per_count = counts, 1 / (counts * self._timestep)
        self._last_count, self._integral, self._last_error = f.last_count.T, f.integral.T, f.last_error.T
        told = FirmwareArrays._fields.index("told_x")
        self._told = self.block[0][told : told + 3].T
        self._body: np.ndarray | None = None
        self._all_body = False
        self._wheels: Array | None = None
        # Calls of `duties` without a new command after which a robot stops; the calls there were, that at which each
        # robot stops, and the first of these.
        timeout = column(firmware, "timeout_s")[:, 0]
        f.stops[:] = f.patience[:] = np.where(timeout > 0, np.rint(timeout / timestep), np.inf)
        self.cycle, self._next_stop = 0, float(f.stops.min())
        for name in ("every", "timestep", "counts_per_rad", "rate_per_count", "kp", "ki", "kd", "nominal"):
            getattr(f, name)[:] = getattr(self, "_" + name)[:, 0]
        f.back_emf[:], f.speed_constant[:] = self._back_emf[:, 0], self._speed_constant[:, 0]
        for name in ("_counts_per_rad", "_rate_per_count", "_kp", "_back_emf", "_nominal"):
            setattr(self, name, arrays.plain(getattr(self, name)))

    def receive(self, received: Received, winding: Array) -> None:
        """Take over what the radio holds in this frame: `correct`, then `obey`.

        Args:
            received: commands, and vision's headings that were sent with them.
            winding: temperatures of the windings (n, wheels), deg C, as a thermal model or sensor tells the driver.
        """
        self.correct(received.heading, received.age, winding)
        self.obey(received)

    def correct(self, heading: Array, age: np.ndarray, winding: Array) -> None:
        """Begin a frame.

        Args:
            heading: vision's that arrived since the frame before, (n,) rad; not a number where none did.
            age: frames since it was sent, (n,).
            winding: temperatures of the windings (n, wheels), deg C, as a thermal model or sensor tells the driver.
        """
        if not self._heeds:
            heading = self._found(heading)
        self.estimate.correct(heading, age)
        if self._derates:
            f, self._swing = self._f, self._f.swing.T
            f.swing[:] = laws.swing(winding.T, f.hot, f.derated, f.resistance)

    def listen(self, heading: Array, age: np.ndarray) -> None:
        """Write down for a compiled loop what `correct` is told."""
        self._f.seen[:] = heading if self._heeds else self._found(heading)
        self._f.age[:] = age

    def _found(self, heading: Array) -> Array:
        """Vision's headings (n,) but for those of robots that do not listen; one that was lost takes it for its own."""
        for robot in np.flatnonzero(self._lost & ~np.isnan(heading)):
            self.estimate.place(int(robot), float(heading[robot]))
            self._lost[robot], self._f.ignores[robot] = False, self._deaf[robot]
            heading = np.where(np.arange(len(heading)) == robot, np.nan, heading)
        return np.where(self._f.off != 0, np.nan, heading)

    def obey(self, received: Received) -> None:
        """Take over commands, from the next call of `duties` on."""
        self.note(received)
        f = self._f
        f.along_x[:], f.along_y[:] = laws.along(f.told_x, f.told_y, f.forward, f.left)
        f.turn_rate[:] = laws.told_turn(f.told_turn, f.turn_gain)
        np.copyto(f.stops, self.cycle + f.patience, where=f.new != 0)
        self._hush()

    def note(self, received: Received) -> None:
        """Write down commands, for `obey` or a compiled loop."""
        f = self._f
        if received.body is not None or self._body is not None:
            self._body = received.body
            f.body[:] = 0.0 if received.body is None else received.body
            self._all_body = self._body is not None and bool(self._body.all())
        if received.wheels is not None or self._wheels is not None:
            self._wheels = None if received.wheels is None else received.wheels / self._radius
            f.rims.T[:] = np.nan if self._wheels is None else self._wheels
        f.new[:] = 1.0 if received.new is None else received.new
        self._told[:] = received.command

    def hear(self, deaf: np.ndarray, off: np.ndarray, encoders: Array) -> None:
        """Have loops run, and obey commands, from now on, but for some robots.

        Where loops begin to run again, all is forgotten: a robot stands until it is told a heading, which it believes.

        Args:
            deaf: which obey no command and stand, (n,).
            off: which run no loop, (n,); their duties are zero.
            encoders: wheel angles (n, wheels), rad.
        """
        f, was = self._f, self._f.off != 0
        new = was & ~off
        f.off[:], self._held[off] = off, 0.0
        self._gated = self._slow or bool(off.any())
        self._integral[new] = self._last_error[new] = f.bias[new] = 0.0
        shown = laws.shown(encoders, self._count_scale, self._count_shift)
        self._last_count[new] = laws.counted(shown, self._counts_per_rad)[new]
        self._lost, self._deaf, self._heeds = (self._lost | new) & ~off, deaf | off, False
        f.ignores[:] = self._deaf | self._lost
        self._hush()

    def mislead(self, gyro: Array, encoders: Array, angle: Array) -> None:
        """Have sensors show `gyro` (n,) and `encoders` (n, wheels) times as much, with wheels now at `angle`, rad."""
        self._f.gyro_scale[:], self._misled = gyro, True
        self._count_shift[:] += (self._count_scale - encoders) * angle
        self._count_scale[:] = encoders

    def _hush(self) -> None:
        """See to robots that are to stop now."""
        stops = self._f.stops
        if not self._heeds:
            np.copyto(stops, np.minimum(stops, self.cycle), where=self._f.ignores != 0)
        self._next_stop = float(np.minimum.reduce(stops))

    def duties(self, gyro: Array, encoders: Array) -> Array:
        """Return the motors' duties (n, wheels) in [-1, 1].

        Args:
            gyro: turn rate (n,), rad/s.
            encoders: wheel angles (n, wheels), rad.
        """
        if self.cycle >= self._next_stop:
            self._stop_where_silent()
        self.cycle += 1
        if not self._gated:
            return self._loops(gyro, encoders)
        due = ((self.cycle - 1) % self._every == 0) & (self._f.off == 0)[:, None]
        if due.any():  # all reckon, elementwise; those whose turn it is keep what came out
            state = self.estimate.heading[:, None], self._last_count, self._integral, self._last_error
            before = [each.copy() for each in state]
            np.copyto(self._held, self._loops(gyro, encoders), where=due)
            for now, then in zip(state, before, strict=True):
                np.copyto(now, then, where=~due)
        return self._held.copy()

    def arrays(self) -> FirmwareArrays:
        """The parts of `block`."""
        return arrays.firmware(*self.block)

    def _loops(self, gyro: Array, encoders: Array) -> Array:
        """What the loops make of the sensors when they run."""
        if self._misled:
            gyro, encoders = self._f.gyro_scale * gyro, laws.shown(encoders, self._count_scale, self._count_shift)
        rate = gyro - self.estimate.bias
        self.estimate.turn(rate, self._each)
        wanted = self._wheel_speeds(rate)
        count = laws.counted(encoders, self._counts_per_rad)
        if self.cycle == 1:  # wherever the wheels stand when the robot is switched on
            self._last_count[:] = count
        speed = (count - self._last_count) * self._rate_per_count
        self._last_count[:] = count
        voltage, error = laws.proportional(wanted, speed, self._kp, self._back_emf)
        if self._integrates:
            gains = self._ki, self._kd, self._timestep, self._nominal
            voltage, integral, windup = laws.integrated(voltage, error, self._last_error, self._integral, *gains)
            np.copyto(self._integral, integral, where=~windup)
            self._last_error[:] = error
        if self._swing is not None:
            voltage = laws.derated(voltage, self._speed_constant * (wanted - error), self._swing)
        return laws.share(voltage, self._nominal)

    def _wheel_speeds(self, rate: Array) -> Array:
        """Wheel speeds (n, wheels) for the commands: equation 2, the turn-rate loop, then the inverse of equation 3."""
        f = self._f
        turn = (f.turn_rate - f.turn_gain * rate)[:, None] * f.turn.T
        if self._all_body:
            wanted: Array = f.along_x.T + turn
        else:
            heading = self.estimate.heading
            if self._body is not None:
                heading = np.where(self._body, 0.0, heading)
            c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
            wanted = laws.wheel_speed(c, s, f.along_x.T, f.along_y.T, turn)
        if self._wheels is None:
            return wanted
        return np.where(np.isnan(self._wheels), wanted, self._wheels)

    def _stop_where_silent(self) -> None:
        """Let robots stand that have had no new command for too long (`firmware.timeout_s`)."""
        f = self._f
        over = self.cycle >= f.stops
        f.along_x[:, over] = f.along_y[:, over] = f.turn_rate[over] = 0.0
        if self._wheels is not None:
            self._wheels = np.where(over[:, None], np.nan, self._wheels)
        self._next_stop = float(f.stops[~over].min(initial=np.inf))

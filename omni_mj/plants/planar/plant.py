"""The planar plant: robots in the plane on wheels that creep and slide, driven by their firmware; see docs/planar.md."""

from collections.abc import Sequence

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, Kinematics
from omni_mj.link.noise import Noise, Stream
from omni_mj.link.radio import Received
from omni_mj.onboard.battery import Battery
from omni_mj.onboard.firmware import Firmware
from omni_mj.onboard.motor import Motor
from omni_mj.onboard.motors import Motors
from omni_mj.onboard.traction import EVERY, Traction
from omni_mj.plants import Telemetry
from omni_mj.plants.planar.bodies import Bodies
from omni_mj.plants.planar.rollers import Standing
from omni_mj.plants.variation import Drawn
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import PERIOD_S, column
from omni_mj.worlds import build
from omni_mj.worlds.contact import ADDED_MASS_KG, DAMPING_RATIO, STIFFNESS_N_M

STUCK_1_S = 400.0  # rate at which a hub comes to rest that its dry friction holds (models/ssl_robot.xml)
PASSES = 3


class PlanarPlant:
    def __init__(self, rows: Sequence[Row], start: Array) -> None:
        settings, n = [row.settings for row in rows], len(rows)
        world = build.world(settings[0])
        self.geometry: Kinematics | None = world.kinematics
        kin = world.kinematics
        wheels = len(kin.azimuths)
        self.cycles, self._h = round(PERIOD_S / build.CYCLE_S), build.CYCLE_S
        self.drawn = Drawn.of(rows)
        self._bodies = b = Bodies(settings, self.drawn, world)
        drive, motors = [s.drive for s in settings], [Motor.of(s.motor) for s in settings]
        self._outward = np.exp(1j * kin.azimuths)
        self._radius = kin.radius - self.drawn.wear
        damping = 2 * DAMPING_RATIO * np.sqrt(STIFFNESS_N_M * (settings[0].body.mass_kg / wheels + ADDED_MASS_KG))
        self._stand = stand = Standing.of(settings[0].wheels, b.load, damping)
        self._lever = stand.lever - self.drawn.wear
        roller = settings[0].wheels.roller_radius_m
        self._bearing = column(drive, "roller_damping_nm_s") / roller**2 * stand.count
        self._spin_up = b.roller / roller**2 * settings[0].wheels.rollers / (2 * np.pi)
        self._grip = 1 / (45 * 604.8 * stand.count) / self._lever**2
        self._dry = column(motors, "wheel_dry") + column(drive, "gear_friction_nm")
        self._viscous = column(motors, "wheel_viscous")
        self._gear = column(motors, "gear")
        self._heading = np.array(start[:, 2], float)
        self._origin = np.array(start[:, :2], float)
        self._velocity = np.zeros((n, 3))  # of the centre of mass
        self._angle, self._angles, self._speed, self._torque = np.zeros((4, n, wheels))
        self._slip = np.zeros((n, wheels))
        self._turn_rates = np.zeros(n)
        self._failed = np.zeros(n, bool)
        self._traction = Traction(
            settings, kin, b.whole.centre, np.ones(1), self._h, self.drawn.friction, self.drawn.wear
        )
        self._load = b.load.copy()
        self._arrange()

        seeds = [row.noise_seed for row in rows]
        self._force = column([s.disturbance for s in settings], "force_n")
        self._pushes = Noise(seeds, Stream.DISTURBANCE, lambda rng, count: rng.uniform(-1, 1, (count, 2)))
        sensors = [s.sensors for s in settings]
        bias = Noise(seeds, Stream.GYRO_BIAS, lambda rng, count: rng.standard_normal((count, 1))).next()
        self._gyro_bias = column(sensors, "gyro_bias_rad_s") * bias
        self._gyro_sigma = column(sensors, "gyro_noise_rad_s")
        self._gyro_noise = Noise(seeds, Stream.GYRO_NOISE, lambda rng, count: rng.standard_normal((count, 1)))
        limit = column([s.firmware for s in settings], "current_limit_a")
        self._motors = Motors([s.motor for s in settings], wheels, PERIOD_S, limit, self.drawn.strength)
        self._battery = Battery([s.battery for s in settings])
        self._firmware = Firmware(settings, kin, self._heading, build.CYCLE_S, PERIOD_S)
        self._speeds, self._voltages, self.currents = np.zeros((3, self.cycles, n, wheels))
        self._supplies = np.zeros((self.cycles, n, 1))
        self._held = None

    def _arrange(self) -> None:
        b = self._bodies
        x, y = b.whole.centre[:, 0], b.whole.centre[:, 1]
        self._shift = x + 1j * y
        tangent = 1j * self._outward
        at = self.geometry.arm * self._outward - self._shift[:, None]
        arm = (at.conj() * tangent).imag
        self._r = np.stack([np.broadcast_to(tangent.real, arm.shape), np.broadcast_to(tangent.imag, arm.shape), arm], -1)
        self._r = self._r / self._lever[..., None]  # rim's angular speed per twist; twist force per torque
        self._rr = self._r[..., [0, 0, 0, 1, 1, 2]] * self._r[..., [0, 1, 2, 1, 2, 2]]
        m, j, z = b.whole.mass, b.whole.inertia, np.zeros(len(x))
        self._mass = (np.stack([m, z, z, m, z, j], -1) + b.rim * self._rr.sum(1)) / self._h
        self._give = self._h / b.hub

    def pose(self) -> Array:
        return np.column_stack([self._origin, self._heading])

    def twist(self) -> Array:
        shift = self._shift * np.exp(1j * self._heading)
        v = self._velocity[:, 0] + 1j * self._velocity[:, 1] - 1j * self._velocity[:, 2] * shift
        return np.column_stack([v.real, v.imag, self._velocity[:, 2]])

    def advance(self, received: Received) -> dict[int, str]:
        motors, battery, firmware, traction = self._motors, self._battery, self._firmware, self._traction
        firmware.obey(received)
        self._push = self._force * self._pushes.next()
        firmware.correct(received.heading, received.age, motors.winding)
        gyro_error = (self._gyro_bias + self._gyro_sigma * self._gyro_noise.next())[:, 0]
        for k in range(self.cycles):
            duty = firmware.duties(self._turn_rates + gyro_error, self._angles)
            self._speeds[k], self._supplies[k, :, 0] = self._speed, battery.voltage
            self._voltages[k], self.currents[k], _ = motors.drive(duty * self._supplies[k], self._speed)
            heading = np.exp(1j * self._heading)
            if k % EVERY == 0:
                self._drag(heading)
            traction.press(self._load)
            self._step(heading, motors.constant * self._gear * self.currents[k])
            battery.load(self._voltages[k], self.currents[k])
        motors.warm(self.currents, self._speeds)
        battery.discharge(PERIOD_S)
        return {}

    def _drag(self, heading) -> None:
        traction, n = self._traction, len(heading)
        half = self._heading / 2
        quaternion = np.stack([np.cos(half), np.zeros(n), np.zeros(n), np.sin(half)], 1)
        twist = self.twist()
        v6 = np.zeros((n, 6))
        v6[:, [0, 1, 5]] = twist
        traction.travel(self._origin, quaternion, v6, self._load)
        body = (twist[:, 0] + 1j * twist[:, 1]) * heading.conj()
        axle = (body[:, None] * self._outward.conj()).real
        aside = -(self._bearing + self._spin_up * np.abs(self._speed)) * axle
        spin, stand = np.abs(self._speed), self._stand
        along = -stand.cost * self._speed / (1 + stand.cost_fades * spin) / self._lever
        self._lift = self._bodies.warped(stand.lift * spin**2 / (1 + stand.lift_fades * spin))
        force = (aside + 1j * along) * self._outward
        at = self.geometry.arm * self._outward - self._shift[:, None]
        drag = (traction.wrench[:, 0] + 1j * traction.wrench[:, 1]) * heading.conj() + force.sum(1)
        self._ground = drag
        push = (self._push[:, 0] + 1j * self._push[:, 1]) * heading.conj()
        total = drag + push
        arm = self._bodies.chassis.centre - self._bodies.whole.centre
        moment = traction.wrench[:, 5] + (at.conj() * force).imag.sum(1)
        moment += arm[:, 0] * push.imag - arm[:, 1] * push.real
        self._outer = np.stack([total.real, total.imag, moment], -1)

    def _step(self, heading, motor) -> None:
        h, t = self._h, self._traction
        v = (self._velocity[:, 0] + 1j * self._velocity[:, 1]) * heading.conj()
        twist = np.stack([v.real, v.imag, self._velocity[:, 2]], -1)
        give, speed = self._give, self._speed
        free = speed + give * (motor - self._viscous * speed)
        rest = (1 - h * STUCK_1_S) * speed
        needed = (free - rest) / give - self._torque
        stuck = np.abs(needed) <= self._dry
        e = np.where(stuck, rest, free - give * np.copysign(self._dry, needed))
        give = np.where(stuck, 0.0, give)
        creep = h * (1 - t.impedance) / t.impedance + self._grip
        y = 1 / (creep + give)
        pull = np.zeros_like(y)
        m = self._mass
        momentum = np.stack([
            m[:, 0] * twist[:, 0] + m[:, 1] * twist[:, 1] + m[:, 2] * twist[:, 2],
            m[:, 1] * twist[:, 0] + m[:, 3] * twist[:, 1] + m[:, 4] * twist[:, 2],
            m[:, 2] * twist[:, 0] + m[:, 4] * twist[:, 1] + m[:, 5] * twist[:, 2]], -1) + self._outer
        after = _solve(m + (y[..., None] * self._rr).sum(1), momentum + ((y * e)[..., None] * self._r).sum(1))
        torque = y * (e - (self._r * after[:, None]).sum(-1))
        limit = t.limit
        over = np.abs(torque) > limit
        for _ in range(PASSES):
            rows = np.flatnonzero(over.any(1))
            if not len(rows):
                break
            y[over] = 0.0
            pull = np.where(over, np.copysign(limit, torque), pull)
            after[rows] = _solve(
                m[rows] + (y[rows][..., None] * self._rr[rows]).sum(1),
                momentum[rows] + ((y * e + pull)[rows][..., None] * self._r[rows]).sum(1),
            )
            torque = np.where(y > 0, y * (e - (self._r * after[:, None]).sum(-1)), pull)
            over = (np.abs(torque) > limit) & (y > 0)
        torque = np.minimum(np.maximum(torque, -limit), limit)
        self._torque = torque
        self._angles, self._turn_rates = self._angle, self._velocity[:, 2]
        self._speed = e - give * torque
        self._angle = self._angle + h * self._speed
        rims = (self._r * after[:, None]).sum(-1)
        self._slip = (self._speed - rims) * self._radius
        world = (after[:, 0] + 1j * after[:, 1]) * heading
        self._velocity = np.column_stack([world.real, world.imag, after[:, 2]])
        centre = self._origin[:, 0] + 1j * self._origin[:, 1] + self._shift * heading + h * world
        self._heading = self._heading + h * after[:, 2]
        origin = centre - self._shift * np.exp(1j * self._heading)
        self._origin = np.column_stack([origin.real, origin.imag])
        height = self._bodies.whole.centre[:, 2]
        pulled = (torque[..., None] * self._r[..., :2]).sum(1)
        self._load = np.maximum(self._bodies.pressed(
            (height * (pulled[:, 0] + self._ground.real))[:, None], (height * (pulled[:, 1] + self._ground.imag))[:, None]
        ) + self._lift, 0.0)

    def telemetry(self) -> Telemetry:
        voltages, supplies = np.abs(self._voltages), self._supplies
        duties = np.divide(voltages, supplies, out=np.zeros_like(voltages), where=supplies > 0)
        return Telemetry(
            wheel_angle=self._angle.copy(),
            wheel_speed=self._speed.copy(),
            voltage=self._voltages[-1].copy(),
            current=self.currents[-1].copy(),
            voltage_mean=self._voltages.mean(0),
            current_mean=self.currents.mean(0),
            duty_peak=np.minimum(duties, 1.0).max((0, 2)),
            voltage_peak=voltages.max((0, 2)),
            current_peak=np.abs(self.currents).max((0, 2)),
            current_limited=self._motors.limited,
            winding=self._motors.winding,
            housing=self._motors.housing,
            battery=self._battery.voltage,
            slip=np.abs(self._slip),
        )


def _solve(a: Array, b: Array) -> Array:
    """x of the symmetric 3x3 systems a x = b, a (n, 6) by rows, b (n, 3)."""
    a11, a12, a13, a22, a23, a33 = a.T
    b1, b2, b3 = b.T
    c11, c12, c13 = a22 * a33 - a23 * a23, a13 * a23 - a12 * a33, a12 * a23 - a13 * a22
    c22, c23, c33 = a11 * a33 - a13 * a13, a12 * a13 - a11 * a23, a11 * a22 - a12 * a12
    det = a11 * c11 + a12 * c12 + a13 * c13
    return np.stack(
        [(c11 * b1 + c12 * b2 + c13 * b3) / det, (c12 * b1 + c22 * b2 + c23 * b3) / det, (c13 * b1 + c23 * b2 + c33 * b3) / det], -1
    )

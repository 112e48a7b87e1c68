"""Between rubber and carpet: creep, Coulomb's limit and drag of every wheel.

**Creep.** Rubber that comes into the contact is unstrained and leaves it strained, as in the brush model of a tyre (H.
B. Pacejka, Tire and Vehicle Dynamics, chapter 3). In a contact of length l that travels at |v| over the carpet, a rim
that slides at s against the direction of its pull strains the rubber by s t after the time t in the contact, s l/|v| at
its end. With a stiffness k per length and strain its traction is f = k l^2 s / (2 |v|): slip speed and traction are
proportional, and the slip falls as the travel grows fresh rubber faster. Contact length and stiffness grow with the
load N so that k l^2 / 2 = C N, with one number C for a robot, its creep stiffness:

    s = |v| f / (N C),    |f| <= mu N.

|v| is the speed of the wheel's centre over the carpet in whatever direction, for rollers bring fresh rubber along the
axle as well; a wheel that stands does not creep. A robot with W wheels whose directions have the cosines d_i, that
speeds up at a, so is slower than its wheels by s/v = T a, T = W / (g C sum d_i^2): measured on robots of TIGERs
Mannheim (`omni-mj slip`).

**How it is computed.** A hinge between hub and rim slides; the contacts below do not. Its dry friction is the limit mu
N R; and as a constraint a + Q tau = -w/h with Q = |v| / (h R^2 N C) it is, over a step h, backward Euler for the law
above: the slip's angular speed becomes w = -h Q tau, for a torque tau = f R. In MuJoCo's words d = A / (A + Q) with the
hinge's inverse inertia A. Load is that which the contacts carried in the step before.

**Drag** acts where wheels touch, in proportion to load. The pile of the carpet is pressed down in front of a wheel and
pushes against it, radially, so not about its axle: p N against the wheel's travel, more against the fibres than with
them (`omni_mj.onboard.carpet`). Rollers turn on plain bearings as
the wheel travels along its axle: b N against that. Both are forces on the body which the wheels must pull, and creep
for. The bearing's goes through the contact, and leaves of the friction circle mu N only sqrt(mu^2 - b^2) N for the rim.
Drag, travel and the carpet under a wheel change slowly, and are looked at every `EVERY` cycles.
"""

from collections.abc import Sequence

import numpy as np

from omni_control.kinematics import Array, Kinematics
from omni_mj.onboard import arrays, laws
from omni_mj.onboard.arrays import TractionArrays
from omni_mj.onboard.carpet import Carpet, Plane
from omni_mj.scenarios.settings import Settings, column

EVERY = 4  # cycles of the wheel loops


class Traction:
    """Wheels of n robots.

    Args:
        settings: one per robot.
        kinematics: of the robots' wheels.
        centre: of mass of the chassis, from the middle of the wheels' contacts, (n, 3) or (3,) m.
        inverse_inertia: of the slip hinges, (W,) 1/(kg m^2).
        timestep: of the physics, s.
        grip: friction of each wheel beside the carpet's, a factor; what broadcasts to (n, W).
        wear: what each wheel has lost of its radius, m; the same.

    Attributes:
        carpet: under them.
        centre: of mass of the chassis, as given, (n, 3) m; what a robot carries may move it.
        limit: highest dry friction of the slip hinges at the last load, (n, W) N m.
        impedance: of the slip hinges' friction constraints, (n, W); MuJoCo keeps it within 0.0001 and 0.9999.
        block: state (see `arrays.rims`).
        wrench: force and torque of the drag on the chassis, world frame, (n, 6) N and N m.
    """

    def __init__(
        self,
        settings: Sequence[Settings],
        kinematics: Kinematics,
        centre: Array,
        inverse_inertia: Array,
        timestep: float,
        grip: Array | float = 1.0,
        wear: Array | float = 0.0,
    ) -> None:
        shape = (len(settings), len(kinematics.azimuths))
        drive = [s.drive for s in settings]
        self._outward = np.exp(1j * kinematics.azimuths)
        self._inward, self._turning = self._outward.conj(), 1j * kinematics.arm
        self.carpet = Carpet([s.carpet for s in settings], kinematics.arm * self._outward)
        self.centre, self._arm = centre * np.ones((shape[0], 3)), kinematics.arm
        self._grip, self._radius = arrays.filled(grip, shape), arrays.filled(kinematics.radius - wear, shape)
        self._whole, self._gap, self._gaps = self._grip.copy(), arrays.filled(0.0, shape), False
        self._bearing, stiffness = column(drive, "roller_friction"), column(drive, "creep_stiffness")
        self._creep = 1 / (timestep * self._radius**2 * stiffness * inverse_inertia)
        self.block = np.zeros((arrays.RIMS, *shape[::-1]))
        self._softness, self._rim_friction, self.limit, self.impedance = (each.T for each in arrays.rims(self.block))
        self.impedance[:] = 1.0
        self.wrench = np.zeros((6, shape[0])).T
        self._friction = np.zeros(shape[::-1])

    def become(self, grip: Array, gap: Array) -> None:
        """From now on have other wheels.

        Args:
            grip: factors of theirs at the start, (n, W).
            gap: where rollers are missing, from a wheel's angle 0 on, (n, W) rad; there it grips nothing.
        """
        self._grip[:], self._gap[:], self._gaps = self._whole * grip, gap, bool(gap.any())

    def travel(
        self, position: Array, quaternion: Array, velocity: Array, load: Array, angle: Array | float = 0.0
    ) -> None:
        """Look at where robots are and go: carpet, drag, and how fast wheels travel.

        Vectors of the plane are complex numbers here, of a wheel's frame with the part along the axle first.

        Args:
            position: (n, 3) m.
            quaternion: (n, 4), of robots that stand upright.
            velocity: of the free joints, (n, 6).
            load: of the wheels, (n, W) N.
            angle: of the wheels, (n, W) rad; it matters to those that have lost rollers.
        """
        heading = (quaternion[:, 0] + 1j * quaternion[:, 3]) ** 2
        body = (velocity[:, 0] + 1j * velocity[:, 1]) * heading.conj()
        self.go(position[:, 0] + 1j * position[:, 1], heading, body, velocity[:, 5], load, angle)

    def go(
        self, place: Plane, heading: Plane, body: Plane, rate: Array, load: Array, angle: Array | float = 0.0
    ) -> None:
        """As `travel`, of robots at a place (n,) m with a heading (n,), a unit vector.

        Args:
            place: see above.
            heading: see above.
            body: velocity in the robot's frame, (n,) m/s.
            rate: of turning, (n,) rad/s.
            load: of the wheels, (n, W) N.
            angle: of the wheels, (n, W) rad; it matters to those that have lost rollers.
        """
        wheel = body * self._inward[:, None] + self._turning * rate  # (W, n), as all that follows lies in memory
        friction = self.carpet.friction(place, heading).T * self._grip.T
        if self._gaps:
            friction = np.where(laws.over_gap(angle, self._gap).T, 0.0, friction)
        speed, direction, held = laws.rolled(wheel, self._bearing[:, 0], friction)
        drag = load.T * (self.carpet.pile(direction.T, heading).T * direction + held)
        force = -arrays.total(drag * self._outward[:, None])
        world = force * heading
        x, y, height = self.centre.T
        wrench = self.wrench
        wrench[:, 0], wrench[:, 1] = world.real, world.imag
        wrench[:, 3], wrench[:, 4] = height * world.imag, -height * world.real
        wrench[:, 5] = -self._arm * arrays.total(drag.imag) - x * force.imag + y * force.real
        np.multiply(self._creep, speed.T, out=self._softness)
        self._rim_friction.T[:] = laws.left_for_the_rim(friction, held, self._radius.T)

    def arrays(self) -> TractionArrays:
        """What a compiled loop reads and writes until the centre or the carpet changes."""
        return TractionArrays(
            outward=self._outward,
            arm=self._arm,
            centre=np.ascontiguousarray(self.centre.T),
            carpet=self.carpet.arrays(),
            grip=self._grip.T,
            gap=self._gap.T,
            gaps=self._gaps,
            bearing=self._bearing[:, 0],
            radius=self._radius.T,
            creep=self._creep.T,
            rims=arrays.rims(self.block),
            friction=self._friction,
            wrench=self.wrench.T,
        )

    def press(self, load: Array) -> None:
        """Find limit and creep of the wheels under a load (n, W) in N."""
        pressed = laws.pressed(load)
        np.multiply(self._rim_friction, pressed, out=self.limit)
        np.divide(pressed, pressed + self._softness, out=self.impedance)

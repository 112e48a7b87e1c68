"""Iterative learning without noise: what a robot can do that has driven the same way before.

An attempt is led by commands that were planned from the best attempt so far, with feedback, since what rolls and counts
is not the same twice. What it shows is planned from again if it is better; if not, the next step is smaller. How
attempts that were sent other commands departed from one another tells what plans are made with (`Deviations`): the
first ones are disturbed for that, and later ones where plans do not hold what they promise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios import references
from omni_mj.scenarios.faults import ON_WHEELS
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.simulate.simulation import Simulation
from omni_mj.studies.limit.attempts import Attempts, Leader, attempt, of, row
from omni_mj.studies.limit.deviations import Deviations
from omni_mj.studies.limit.follower import Follower, regulator
from omni_mj.studies.limit.plan import AIMS, Aim, Planner
from omni_mj.studies.limit.predictor import Predictor
from omni_mj.studies.limit.unknowns import Unknowns
from omni_mj.studies.outcome import AfterFrame

Begin = Callable[[str, int], AfterFrame]
TEACHERS = ("comp-flc", "adaptive-comp-flc", "smith", "lqr")  # whose runs are the first to be learned from
STEPS = (1.0, 0.5)  # shares of a planned change that are tried side by side
SMALLEST_STEP = 1 / 64
WEIGHTS = (0.1, 0.03, 0.01, 0.003)  # of the regulator: stiffer after an attempt that is better, softer if none was
SOFTER = 4.0  # times the weight, for the smaller steps
# By which commands are disturbed, m/s and rad/s. Less than half of it, and feedback on what is not foreseen would be
# taken for cause and effect.
PROBE = np.array([0.1, 0.1, 0.5])
PROBED, PROBES = 2, 3  # so many attempts at the least, with so many rows each
HELD = 0.5  # share of what was promised, below which deviations are told anew
ENOUGH_M = 5e-5  # as good as what was promised
HEADING_M = 0.01  # per rad: what a wrong heading counts beside the plane
ASTRAY, ASTRAY_M = 4.0, 0.05  # times the error of the best row: those beyond both tell nothing of runs near it
PATIENCE, PROGRESS, PROGRESS_M = 3, 0.04, 2e-5  # learning ends after as many attempts that gained less


@dataclass(eq=False)
class Best:
    """The best run so far of each of L robots, by one aim.

    Attributes:
        asked, sent, poses, errors: of these runs, (F, L, 3); see `Attempts`.
        merit: what shall be least, (L,) m.
        step: share of a planned change that is tried next, (L,).
    """

    asked: Array
    sent: Array
    poses: Array
    errors: Array
    merit: Array
    step: Array = field(init=False)

    def __post_init__(self) -> None:
        self.step = np.ones_like(self.merit)

    def take(self, made: Attempts, merit: Array, robot: int, number: int) -> bool:
        """Take row `number` for a robot if it is better."""
        if not merit[number] < self.merit[robot]:
            return False
        for name in ("asked", "sent", "poses", "errors"):
            getattr(self, name)[:, robot] = getattr(made, name)[:, number]
        self.merit[robot] = merit[number]
        return True


class Learner:
    """Learns the way of a scenario for L robots side by side.

    Args:
        scenario: without noise.
        seeds: of the robots, L of them.
        begin: called with a title and the number of frames before each attempt; what it returns is called after each
            frame.

    Attributes:
        best: by aim.
        deviations: near the runs.
        history: after each attempt, the median over robots of the least maximum and the least mean of the error in the
            plane so far, in m.
    """

    def __init__(self, scenario: Scenario, seeds: Sequence[int], begin: Begin) -> None:
        self.scenario, self.seeds, self._begin = scenario, list(seeds), begin
        settings = scenario.settings
        self.reference = references.timed(settings, row(scenario, 0, 0).where).poses
        frames, robots, delay = len(self.reference), len(self.seeds), settings.radio.delay_frames
        self.deviations = Deviations.prior(frames, delay, 2 * settings.control.lag_s)
        self.history: list[dict[Aim, float]] = []
        self._limits = references.motion_limits(settings.control)
        self._random = np.random.default_rng(0)
        self._stiffness = 0
        self._told: list[tuple[Array, Array]] = []
        forward = np.zeros((frames, 3))
        forward[: max(frames - 1 - delay, 0)] = np.diff(self.reference, axis=0)[delay:] / PERIOD_S
        start = [
            np.repeat(values[:, None], robots, axis=1)
            for values in (forward, forward, self.reference, np.zeros((frames, 3)))
        ]
        self.best: dict[Aim, Best] = {}
        for aim in AIMS:
            asked, sent, poses, errors = (values.copy() for values in start)
            self.best[aim] = Best(asked, sent, poses, errors, np.full(robots, np.inf))

    def learn(self, attempts: int) -> None:
        """Begin with what controllers do, go on from there, and tell how robots depart from the best run."""
        self._be_taught()
        self._explore()
        self._go_on(attempts)
        self._explore()

    def learn_on(self, scenario: Scenario, attempts: int) -> None:
        """Go on with the same robots on other wheels, or the like."""
        self.scenario = scenario
        for best in self.best.values():
            best.merit[:], best.step[:] = np.inf, 1.0
        self._judge(self._try(self._unchanged(), WEIGHTS[-1], 0, "own wheels"))
        self._go_on(attempts)

    def _explore(self) -> None:
        """Tell from runs near the best, and from no others, how robots depart from it."""
        self._told.clear()
        self._try((self.best["max"].sent, self.best["max"].poses), WEIGHTS[0], PROBES, "departures")

    def _go_on(self, attempts: int) -> None:
        """Attempt after attempt, until they gain nothing any more."""
        idle, first, probe = 0, len(self.history), len(self.history) == 1
        for number in range(first, first + attempts):
            weight = WEIGHTS[self._stiffness]
            was = self._merits()
            planned, promised = self._planned()
            self._judge(self._try(planned, weight, PROBES if probe else 0, f"attempt {number}"))
            now = self._merits()
            short = now - promised > np.maximum(HELD * (was - promised), ENOUGH_M)
            probe = bool(short.any()) or number < PROBED
            better = (now < was).any()
            self._stiffness = min(max(self._stiffness + (1 if better else -2), 0), len(WEIGHTS) - 1)
            idle = 0 if (was - now > np.maximum(PROGRESS * was, PROGRESS_M)).any() else idle + 1
            if idle == PATIENCE:
                break

    def _merits(self) -> Array:
        return np.array([np.median(best.merit) for best in self.best.values()])

    def _unchanged(self) -> tuple[Array, Array]:
        """Commands and poses (F, rows, 3) of the best runs, for each aim and step."""
        several = [(best.sent, best.poses) for best in self.best.values() for _ in STEPS]
        commands, poses = (np.concatenate(part, axis=1) for part in zip(*several, strict=True))
        return commands, poses

    def _planned(self) -> tuple[tuple[Array, Array], Array]:
        """The same after a change that is planned, and what whole changes promise of each aim."""
        planner = Planner(self.deviations, self._limits)
        commands, poses, promised = list[Array](), list[Array](), []
        for aim, best in self.best.items():
            wanted, errors = planner.improve(best.errors, best.sent, aim)
            promised.append(np.median(merits(errors, aim)))
            for step in STEPS:
                share = (step * best.step)[:, None]
                commands.append(best.sent + share * (wanted - best.sent))
                poses.append(best.poses + share * (errors - best.errors))
        return (np.concatenate(commands, axis=1), np.concatenate(poses, axis=1)), np.array(promised)

    def _try(self, planned: tuple[Array, Array], weight: float, probes: int, title: str) -> Attempts:
        """Lead robots along runs, the first of them so many times more, disturbed."""
        settings, robots = self.scenario.settings, len(self.seeds)
        commands, poses = (np.concatenate([part] + probes * [part[:, :robots]], axis=1) for part in planned)
        groups = commands.shape[1] // robots
        disturbed = np.arange(groups) >= groups - probes
        gains = np.stack([regulator(self.deviations, weight), regulator(self.deviations, SOFTER * weight)], axis=1)
        which = np.repeat(np.arange(groups) % len(STEPS) * ~disturbed, robots)
        unknowns = Unknowns.of(settings, self.scenario.plant)
        firmware = self.scenario.plant in ON_WHEELS
        predictor = Predictor(self.deviations, commands, poses, settings, unknowns, firmware)
        leader: Leader = Follower(predictor, gains, which)
        if probes:
            leader = _Disturbed(leader, np.repeat(disturbed, robots)[:, None] * self._probes(commands.shape))
        made = attempt(self.scenario, self.seeds * groups, leader, self._begin(title, len(commands)))
        if probes:
            self._tell(made)
        return made

    def _probes(self, shape: tuple[int, ...]) -> Array:
        """Random changes of commands, of two frames each."""
        white = PROBE * self._random.standard_normal(shape)
        white[1:] += white[:-1].copy()
        return white / np.sqrt(2)

    def _tell(self, made: Attempts) -> None:
        """Fit deviations to how rows of one robot differ, in these attempts and the last that were disturbed."""
        robots, farthest = len(self.seeds), merits(made.errors, "max")
        for robot in range(robots):
            rows = sorted(range(robot, len(farthest), robots), key=lambda i: farthest[i])
            rows = [i for i in rows if farthest[i] < max(ASTRAY * farthest[rows[0]], ASTRAY_M)]
            if len(rows) > 1:
                first, others = rows[:1], rows[1:]
                poses, sent = (values[:, others] - values[:, first] for values in (made.poses, made.sent))
                self._told.append((poses, sent))
        self._told = self._told[-2 * robots :]
        if self._told:
            poses, sent = (np.concatenate(part, axis=1) for part in zip(*self._told, strict=True))
            self.deviations = Deviations.fit(self.reference, self.deviations.delay, poses, sent)

    def _judge(self, made: Attempts) -> None:
        """Take what is better, and choose the next steps."""
        robots = len(self.seeds)
        for aim, best in self.best.items():
            merit = merits(made.errors, aim)
            for robot in range(robots):
                winner = min(range(robot, len(merit), robots), key=lambda i: merit[i])
                if not best.take(made, merit, robot, winner):
                    best.step[robot] = max(best.step[robot] / 4, SMALLEST_STEP)
                elif (winner // robots) % len(STEPS) == 0:
                    best.step[robot] = min(2 * best.step[robot], 1.0)
        self._note()

    def _be_taught(self) -> None:
        """Let controllers drive, and take the best of them."""
        several = [(seed, name) for name in TEACHERS for seed in self.seeds]
        rows = [row(self.scenario, i, seed, name) for i, (seed, name) in enumerate(several)]
        simulation = Simulation(self.scenario, TEACHERS, rows=rows)
        simulation.run(self._begin("controllers", len(self.reference)))
        sent = simulation.log.channel("command")
        made = of(simulation, sent, simulation.log.channel("vision"), simulation.log.channel("vision")[..., 2])
        for aim, best in self.best.items():
            merit = merits(made.errors, aim)
            for i in range(len(rows)):
                best.take(made, merit, i % len(self.seeds), i)
        self._note()

    def _note(self) -> None:
        size = {aim: np.hypot(best.errors[..., 0], best.errors[..., 1]) for aim, best in self.best.items()}
        found = {"max": size["max"].max(0), "mean": size["mean"].mean(0)}
        self.history.append({aim: float(np.median(found[aim])) for aim in AIMS})


class _Disturbed:
    """Leads as another does, but for disturbances (F, n, 3)."""

    def __init__(self, leader: Leader, disturbances: Array) -> None:
        self._leader, self._next = leader, iter(disturbances)

    def __call__(self, measured: Array, heading: Array) -> Array:
        return self._leader(measured, heading) + next(self._next)

    def sent(self, command: Array) -> None:
        self._leader.sent(command)


def merits(errors: Array, aim: Aim) -> Array:
    """What shall be least of errors (F, n, 3): their maximum or mean in the plane, and a little of the heading's."""
    size = np.hypot(errors[..., 0], errors[..., 1]) + HEADING_M * np.abs(errors[..., 2])
    return size.max(0) if aim == "max" else size.mean(0)

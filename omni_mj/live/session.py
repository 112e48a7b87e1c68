"""From what a user names to robots that stand where their route begins: sockets, who is there, who is driven."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, wrap_angle
from omni_mj.live import answer
from omni_mj.live.drive import Live, ways
from omni_mj.live.link import Link, Pace
from omni_mj.live.listen import Listener
from omni_mj.live.notes import Notes
from omni_mj.live.radio import Line, Radio, SimulatorRadio
from omni_mj.live.sockets import LOOPBACK, Address, Receiver
from omni_mj.live.vision import Colour, Vision
from omni_mj.live.wire.vision import SIMULATED_VISION_PORT, VISION_GROUP
from omni_mj.scenarios import distributions, references, rows, user_files
from omni_mj.scenarios.controllers import find, label
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ

SIMULATED_VISION = Address(VISION_GROUP, SIMULATED_VISION_PORT)
LISTEN_S = 1.5  # at first: rates are known to a part in some hundreds, clocks to a fraction of a millisecond
MOST_ROBOTS = 12
DEAD_TIME = "radio.delay_frames"
MEASURED = (DEAD_TIME, *(f"vision.{name}" for name in ("position_noise_m", "heading_noise_rad", "delay_s")))


@dataclass(frozen=True)
class Options:
    """What a user says of the connection.

    Attributes:
        vision: the group or address to which SSL-Vision is sent.
        commands: where the simulator or the radio is; None for the usual place.
        interface: address of that by which packets come and leave.
        colour: of the team.
        ids: the robots' numbers; none for the lowest that are seen.
        pace: what gives the ticks.
        world: whether robots are told velocities along the field.
        radio: a class of a team's own, as `file.py:Class`; None for the simulation protocol.
        here: whether routes begin where the robots are, in place of bringing robots to where routes begin.
        wait_s, listen_s: how long vision is waited for, and listened to before anything else.
        duration_s: after which it ends, if not before; None for the whole route.
        measured: settings, of `MEASURED`, for which what is measured before counts: what the team believes.
    """

    vision: Address = SIMULATED_VISION
    commands: Address | None = None
    interface: str = LOOPBACK
    colour: Colour = "blue"
    ids: tuple[int, ...] = ()
    pace: Pace = "auto"
    world: bool = False
    radio: str | None = None
    here: bool = False
    wait_s: float = 10.0
    listen_s: float = LISTEN_S
    duration_s: float | None = None
    measured: frozenset[str] = frozenset(MEASURED)


def check(scenario: Scenario, options: Options) -> None:
    """See that a scenario can be driven, before anything is opened.

    Raises:
        OmniError: it cannot; a line for each reason.
    """
    distributions.refuse(scenario.distributions, "drive")
    wrong = []
    if len(scenario.controllers) != 1 or scenario.seeds != 1:
        names = ", ".join(label(kind) for kind in scenario.controllers)
        wrong.append(f"robots have one controller each, and one chance: give one --controller, one seed, not {names}")
    wrong += [
        f"{label(kind)} must be given the true pose, which nobody knows of robots outside of this program"
        for kind in scenario.controllers
        if find(kind).knows_truth
    ]
    if scenario.settings.fault:
        wrong.append(
            "nothing can be made to happen to robots outside of this program: the scenario must have no [[fault]]"
        )
    if len(set(options.ids)) != len(options.ids) or len(options.ids) > MOST_ROBOTS:
        wrong.append(f"--id must name up to {MOST_ROBOTS} robots, each once, not {options.ids}")
    places = len(scenario.settings.world.places)
    if options.ids and len(options.ids) != places and not options.here:
        wrong.append(
            f"{len(options.ids)} robots are named, and the scenario has places for {places} (world.places);"
            " with --here, each drives from where it is"
        )
    if wrong:
        raise OmniError("\n".join(wrong))


@contextmanager
def listening(options: Options, notes: Notes, checked: Callable[[], None] = lambda: None) -> Iterator[Link]:
    """Listen to vision until the end of the block.

    Args:
        options: where it is.
        notes: of what is wrong with it.
        checked: called now and then; what it raises ends whatever goes on.

    Raises:
        OmniError: nothing came for as long as was to be waited.
    """
    receiver = Receiver(options.vision, options.interface)
    try:
        link = Link(receiver, Vision(options.colour, options.ids, notes), checked)
        until = time.monotonic() + options.wait_s
        while not link.vision.cameras:
            if time.monotonic() > until:
                bad = notes.counts["bad packet"]
                only = f", but for {bad} bad packets," if bad else ""
                raise OmniError(
                    f"no vision came to {options.vision} by the interface {options.interface}{only} for"
                    f" {options.wait_s:g} s; --vision and --interface say where it is"
                )
            link.listen(0.1)
        link.listen(options.listen_s)
        yield link
    finally:
        receiver.close()


@contextmanager
def ready(scenario: Scenario, options: Options, link: Link, notes: Notes) -> Iterator[Live]:
    """Robots to be driven, at the start of their routes; they are told to stand when the block ends.

    Raises:
        OmniError: they are not seen, cannot be driven so, or do not answer.
    """
    ids = _chosen(scenario, options, link.heard)
    link.vision.follow(ids)
    pose = link.believe()
    link.choose(options.pace)
    kind = SimulatorRadio if options.radio is None else _own(options.radio)
    both = options.pace != "vision"  # a simulation that waits for commands would take it for one
    radio = kind(Line(options.commands, options.colour, options.interface, options.world, notes, both))
    try:
        there = _placed(scenario, pose) if options.here else scenario
        there = _told(there, "vision.", options, link.heard.noise(options.colour, ids) | link.timing)
        if DEAD_TIME in options.measured:
            there = _told(there, "radio.", options, {DEAD_TIME: _dead_time(there, link, radio, ids, pose, notes)})
        most = np.inf if options.duration_s is None else round(options.duration_s * FRAME_RATE_HZ)
        live = Live(there, link, radio, ids, notes, most_frames=most)
        live.warm(pose)
        try:
            live.approach(np.array([reference.poses[0] for reference in live.references]))
            link.restart()
            link.answers.clear()  # what counts begins now
            link.late = link.missing = 0
            yield live
        finally:
            live.stop()
    finally:
        radio.close()


def _dead_time(scenario: Scenario, link: Link, radio: Radio, ids: Sequence[int], pose: Array, notes: Notes) -> int:
    """Frames from a command to its effect, without the wheel loops' lag, as robots answer a pulse."""
    table = rows.table([label(scenario.controllers[0])], [scenario.seed], scenario.settings_of, scenario.robot)
    trial = Live(scenario, link, radio, ids, notes, ways(table, pose, pose))
    try:
        answers = answer.pulse(trial)
    finally:
        trial.stop()
    still = [number for number, each in zip(ids, answers, strict=True) if not each.any]
    if still:
        raise OmniError(
            f"robots {', '.join(map(str, still))} do not turn as they are told: --team, --commands and --velocity say"
            " how they are told; --no-pulse does without asking them"
        )
    latency = float(np.median([each.latency for each in answers]))
    lag = scenario.settings.control.lag_s * FRAME_RATE_HZ
    notes.add(
        "pulse",
        f"robots answer a pulse {latency:.2f} frames later ({1e3 * latency / FRAME_RATE_HZ:.0f} ms)",
        always=True,
    )
    link.restart()
    return max(round(latency - lag), 0)


def _told(scenario: Scenario, section: str, options: Options, measured: Mapping[str, float]) -> Scenario:
    """The scenario with what was measured of a section in place of its settings, where it may be."""
    name = section.rstrip(".")
    values = {
        key.removeprefix(section): value
        for key, value in measured.items()
        if key in options.measured and np.isfinite(value)
    }
    return scenario.replace(settings=scenario.settings.replace(**{name: values})) if values else scenario


def _chosen(scenario: Scenario, options: Options, heard: Listener) -> list[int]:
    """The numbers of the robots that are driven."""
    seen, places = heard.ids(options.colour), len(scenario.settings.world.places)
    ids = list(options.ids) or seen[: MOST_ROBOTS if options.here else places]
    missing = [number for number in ids if number not in seen]
    if missing or not ids or (len(ids) < places and not options.here):
        there = f"of {options.colour}, it sees {', '.join(map(str, seen)) or 'none'}"
        wanted = (
            f"robots {', '.join(map(str, missing))}" if missing else f"as many robots as there are places, {places}"
        )
        raise OmniError(f"vision does not see {wanted}; {there}: --team and --id say who is driven")
    return ids


def _placed(scenario: Scenario, seen: Array) -> Scenario:
    """The scenario with each robot's route displaced so that it begins where the robot is, facing as it does."""
    if np.isnan(seen).any():
        raise OmniError("not all robots are seen")
    x, y, heading = references.timed(scenario.settings).poses[0]
    turn = wrap_angle(seen[:, 2] - heading)
    c, s = np.cos(turn), np.sin(turn)
    places = np.column_stack([seen[:, 0] - (c * x - s * y), seen[:, 1] - (s * x + c * y), turn])
    return scenario.replace(settings=scenario.settings.replace(world={"places": places.tolist()}))


def _own(name: str) -> type[Radio]:
    """A radio of the user's own.

    Raises:
        OmniError: there is no such class.
    """
    if not user_files.names_class(name):
        raise OmniError(f"--radio must be file.py:Class, not {name!r}")
    return user_files.find(name, "derived from omni_mj.live.radio.Radio", lambda kind: issubclass(kind, Radio))

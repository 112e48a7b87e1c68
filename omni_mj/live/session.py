"""From what a user names to robots that are ready to be driven: sockets, who is there, who is driven."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, wrap_angle
from omni_mj.config import distributions, plugins, reference_factory
from omni_mj.config.plugins import label
from omni_mj.config.scenario import Scenario
from omni_mj.config.settings import FRAME_RATE_HZ
from omni_mj.live.command_senders import PORTS, Line, Radio, SimulatorRadio
from omni_mj.live.frame_clock import Link, Pace
from omni_mj.live.latency_fit import measure_pulse
from omni_mj.live.live_loop import Live
from omni_mj.live.sockets import LOOPBACK, Address, Notes, Receiver, address
from omni_mj.live.ssl_vision import Colour, Vision
from omni_mj.live.wire import VISION_GROUP, VISION_PORT

# At first: rates are known to a part in some hundreds, clocks to a fraction of a millisecond
LISTEN_S = 1.5
MAX_ROBOTS = 12
MIN_GAIN = 0.3  # of a robot that responds at all to a pulse
PULSE_S = 3.0  # by which a route is longer while a pulse is measured
DEAD_TIME = "radio.delay_frames"


@dataclass(frozen=True)
class Options:
    """What a user says of the connection.

    Attributes:
        vision: The group or address to which SSL-Vision is sent, HOST[:PORT].
        commands: Address of the simulator or the radio; None for the usual one.
        interface: Address of the network interface.
        colour: Of the team.
        ids: The robots' numbers; none for the lowest that are seen.
        pace: What gives the ticks.
        radio: A class of a team's own, as `file.py:Class`; None for the simulation protocol.
        wait_s, listen_s: How long vision is waited for, and listened to before anything else.
        duration_s: After which it ends; None for the whole route.
        pulse: Whether the dead time is measured.
        overrides: Settings that are left alone, `section.field=value`; others may be measured
            before.
    """

    vision: str = VISION_GROUP
    commands: str | None = None
    interface: str = LOOPBACK
    colour: Colour = "blue"
    ids: tuple[int, ...] = ()
    pace: Pace = "auto"
    radio: str | None = None
    wait_s: float = 10.0
    listen_s: float = LISTEN_S
    duration_s: float | None = None
    pulse: bool = True
    overrides: tuple[str, ...] = ()

    @property
    def vision_address(self) -> Address:
        """Where vision comes to; it raises `OmniError` if there is no such address."""
        return address(self.vision, VISION_PORT)

    @property
    def line(self) -> Line:
        """Where the radio leads; it raises `OmniError` if there is no such address."""
        interface = "" if self.radio else self.interface
        target = address(self.commands, PORTS[self.colour], interface) if self.commands else None
        # A simulation that waits for commands would take an empty packet for one
        both = self.pace != "vision"
        return Line(target, self.colour, self.interface, both)

    def fixes(self, name: str) -> bool:
        """Return whether a setting is left alone."""
        return any(override.partition("=")[0].strip() == name for override in self.overrides)


def check(scenario: Scenario, options: Options) -> None:
    """Check that a scenario can be driven, before anything is opened.

    Raises:
        OmniError: It cannot; a line for each reason.
    """
    distributions.refuse(scenario.distributions, "drive")
    _ = options.vision_address, options.line  # each raises if it is none
    errors = list[str]()
    (controller,) = scenario.controllers
    if plugins.find_controller(controller).knows_truth:
        name = label(controller)
        errors.append(
            f"{name} must be given the true pose, which nobody knows of robots outside of this program"
        )
    if scenario.settings.fault:
        errors.append(
            "nothing can be made to happen to robots outside of this program: the scenario must have no [[fault]]"
        )
    if len(set(options.ids)) != len(options.ids) or len(options.ids) > MAX_ROBOTS:
        errors.append(f"--id must name up to {MAX_ROBOTS} robots, each once, not {options.ids}")
    if errors:
        raise OmniError("\n".join(errors))


@contextmanager
def listening(
    options: Options, notes: Notes, check_stop: Callable[[], None] = lambda: None
) -> Iterator[Link]:
    """Listen to vision until the end of the block.

    Args:
        options: Where it is.
        notes: What is wrong with it.
        check_stop: Called now and then; what it raises ends whatever goes on.

    Raises:
        OmniError: Nothing came.
    """
    with Receiver(options.vision_address, options.interface) as receiver:
        link = Link(receiver, Vision(options.colour, notes), check_stop)
        until = time.monotonic() + options.wait_s
        while not link.vision.cameras:
            if time.monotonic() > until:
                raise OmniError(
                    f"no vision came to {options.vision} by the interface {options.interface} for"
                    f" {options.wait_s:g} s; --vision and --interface say where it is"
                )
            link.listen(0.1)
        link.listen(options.listen_s)
        yield link


@contextmanager
def ready(scenario: Scenario, options: Options, link: Link) -> Iterator[Live]:
    """Prepare a drive that begins where the robots stand. They are told to stand when the block ends.

    Raises:
        OmniError: They are not seen, cannot be driven so, or do not respond.
    """
    vision = link.vision
    vision.ids = _chosen_ids(scenario, options, vision.seen_ids())
    link.choose_ticks(options.pace)
    radio_type = SimulatorRadio if options.radio is None else _find_radio(options.radio)
    with closing(radio_type(options.line, vision.notes)) as radio:
        chosen = _with_measured(
            _displaced(scenario, vision.resting_poses()), options, vision.noise()
        )
        if options.pulse and not options.fixes(DEAD_TIME):
            settle_s = chosen.settings.reference.settle_s + PULSE_S
            longer = chosen.settings.replace(reference={"settle_s": settle_s})
            trial = Live(chosen.replace(settings=longer), link, radio, vision.ids)
            chosen = _with_measured(chosen, options, {DEAD_TIME: _dead_time(trial)})
        max_frames = (
            np.inf if options.duration_s is None else round(options.duration_s * FRAME_RATE_HZ)
        )
        live = Live(chosen, link, radio, vision.ids, max_frames)
        live.team.step(vision.resting_poses())  # what controllers make at first, before robots wait
        live.reset()
        try:
            yield live
        finally:
            live.stop()


def _dead_time(trial: Live) -> int:
    """Return frames from a command to its effect, without the wheel loops' lag, by a pulse."""
    try:
        responses = measure_pulse(trial)
    finally:
        trial.stop()
    silent = [
        str(number)
        for number, each in zip(trial.ids, responses, strict=True)
        if not each.gain >= MIN_GAIN
    ]
    if silent:
        raise OmniError(
            f"robots {', '.join(silent)} do not turn as they are told: --team and --commands say"
            " where they are told; --no-pulse does without asking them"
        )
    latency = float(np.median([response.latency for response in responses]))
    ms = 1e3 * latency / FRAME_RATE_HZ
    trial.notes.add("pulse", f"robots answer a pulse {latency:.2f} frames later ({ms:.0f} ms)")
    return max(round(latency - trial.scenario.settings.control.lag_s * FRAME_RATE_HZ), 0)


def _with_measured(scenario: Scenario, options: Options, measured: Mapping[str, float]) -> Scenario:
    """Return the scenario with measured settings, where the options allow it."""
    settings = scenario.settings
    for name, value in measured.items():
        if not options.fixes(name) and np.isfinite(value):
            section, field = name.split(".")
            settings = settings.replace(**{section: {field: value}})
    return scenario.replace(settings=settings)


def _chosen_ids(scenario: Scenario, options: Options, seen: Sequence[int]) -> list[int]:
    """Return the numbers of the robots that are driven."""
    places = len(scenario.settings.world.start_poses)
    ids = list(options.ids) or list(seen[:places])
    missing = ", ".join(str(number) for number in ids if number not in seen)
    if missing or not ids or (len(ids) < places and not options.ids):
        visible = f"of {options.colour}, it sees {', '.join(map(str, seen)) or 'none'}"
        robots = f"robots {missing}" if missing else f"as many robots as there are places, {places}"
        raise OmniError(
            f"vision does not see {robots}; {visible}: --team and --id say who is driven"
        )
    return ids


def _displaced(scenario: Scenario, poses: Array) -> Scenario:
    """Return the scenario with each robot's route moved and turned to begin where the robot is."""
    x, y, heading = reference_factory.timed(scenario.settings).poses[0]
    turn = wrap_angle(poses[:, 2] - heading)
    c, s = np.cos(turn), np.sin(turn)
    places = np.column_stack([poses[:, 0] - (c * x - s * y), poses[:, 1] - (s * x + c * y), turn])
    return scenario.replace(
        settings=scenario.settings.replace(world={"start_poses": places.tolist()})
    )


def _find_radio(name: str) -> type[Radio]:
    """Return a radio of the user's own.

    Raises:
        OmniError: There is no such class.
    """
    if not plugins.names_class(name):
        raise OmniError(f"--radio must be file.py:Class, not {name!r}")
    return plugins.find_class(
        name,
        "derived from omni_mj.live.command_senders.Radio",
        lambda kind: issubclass(kind, Radio),
    )

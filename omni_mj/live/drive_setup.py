"""Set-up of a live drive: open sockets, choose the robots, measure the dead time."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, body_to_world, wrap_angle
from omni_mj.config import FRAME_RATE_HZ, distributions, plugins, reference_factory
from omni_mj.config.plugins import label_controller
from omni_mj.config.scenario import Scenario
from omni_mj.io.printable_text import format_count
from omni_mj.live.frame_clock import FrameClock, Pace
from omni_mj.live.latency_fit import format_latency, measure_pulse
from omni_mj.live.live_loop import Live
from omni_mj.live.sockets import Address, MessageCounter, Receiver, parse_address
from omni_mj.live.ssl_vision import SslVision, TeamColor
from omni_mj.live.team_radio import PORTS, SenderConfig, SimulatorRadio, TeamRadio
from omni_mj.live.wire import VISION_PORT

# After this time, frame rates are known within 1 % and clock offsets within a fraction of 1 ms.
LISTEN_S = 1.5
MAX_ROBOTS = 12
MIN_ALPHA = 0.3  # smallest alpha of a robot that responds to a pulse
PULSE_S = 3.0  # extra duration of a reference while a pulse is measured
DEAD_TIME = "radio.delay_frames"


@dataclass(frozen=True)
class ConnectionOptions:
    """Connection options of `omni-mj drive`.

    Attributes:
        vision: Multicast group or address of SSL-Vision, HOST[:PORT].
        commands: Address of the simulator or the radio. None: the default address of the team.
        interface: Address of the network interface.
        color: Color of the team.
        ids: Numbers of the robots. Empty: the lowest numbers that vision detects.
        pace: Source of frames, see `FrameClock.choose_source`.
        radio: A radio of the user's own, `file.py:Class`. None: the simulation protocol.
        wait_s: How long to wait for the first vision packet, s.
        duration_s: Duration of the drive, s. None: the whole reference.
        pulse: Whether to measure the dead time first.
        overrides: Settings that the user fixes, `section.field=value`. Measured values replace
            others.
        listen_s: How long to listen to vision before anything else, s.
    """

    vision: str
    commands: str | None
    interface: str
    color: TeamColor
    ids: tuple[int, ...]
    pace: Pace
    radio: str | None
    wait_s: float
    duration_s: float | None
    pulse: bool
    overrides: tuple[str, ...]
    listen_s: float = LISTEN_S

    @property
    def vision_address(self) -> Address:
        """Return the address of SSL-Vision; raise `OmniError` if it is malformed."""
        return parse_address(self.vision, VISION_PORT)

    @property
    def sender_config(self) -> SenderConfig:
        """Return the destination of commands; raise `OmniError` if its address is malformed."""
        interface = "" if self.radio else self.interface
        target = (
            parse_address(self.commands, PORTS[self.color], interface) if self.commands else None
        )
        # A simulator that waits for commands would advance by an empty packet.
        reaches_both_teams = self.pace != "vision"
        return SenderConfig(target, self.color, self.interface, reaches_both_teams)

    def is_overridden(self, name: str) -> bool:
        """Return whether the user fixes a setting."""
        return any(override.partition("=")[0].strip() == name for override in self.overrides)


def check_drivable(scenario: Scenario, options: ConnectionOptions) -> None:
    """Check that external robots can drive a scenario.

    Raises:
        OmniError: External robots cannot drive it; one line for each reason.
    """
    distributions.require_fixed_settings(scenario.distributions, "drive")
    _ = options.vision_address, options.sender_config  # raise if malformed
    errors = list[str]()
    (controller,) = scenario.controllers
    if plugins.find_controller(controller).knows_truth:
        name = label_controller(controller)
        errors.append(f"{name} needs the true pose, which is unknown for external robots")
    if scenario.settings.fault:
        errors.append(
            "faults cannot be injected into external robots: the scenario must have no [[fault]]"
        )
    if len(set(options.ids)) != len(options.ids) or len(options.ids) > MAX_ROBOTS:
        errors.append(f"--id must name at most {MAX_ROBOTS} different robots, got {options.ids}")
    if errors:
        raise OmniError("\n".join(errors))


@contextmanager
def open_vision(
    options: ConnectionOptions,
    messages: MessageCounter,
    check_stop: Callable[[], None] = lambda: None,
) -> Iterator[FrameClock]:
    """Receive vision packets until the end of the block.

    Args:
        options: Connection options.
        messages: Counts problems with packets.
        check_stop: Called at least every 0.05 s. An exception that it raises ends the block.

    Raises:
        OmniError: No packet arrived.
    """
    with Receiver(options.vision_address, options.interface) as receiver:
        frame_clock = FrameClock(receiver, SslVision(options.color, messages), check_stop)
        until = time.monotonic() + options.wait_s
        while not frame_clock.vision.cameras:
            if time.monotonic() > until:
                raise OmniError(
                    f"no vision packet arrived at {options.vision} on the interface"
                    f" {options.interface} within {options.wait_s:g} s;"
                    " check --vision and --interface"
                )
            frame_clock.listen_for(0.1)
        frame_clock.listen_for(options.listen_s)
        yield frame_clock


@contextmanager
def prepare_drive(
    scenario: Scenario, options: ConnectionOptions, frame_clock: FrameClock
) -> Iterator[Live]:
    """Prepare a drive that starts at the robots' present poses. Stop the robots at the end.

    Raises:
        OmniError: Vision does not detect the robots, or they do not respond to commands.
    """
    vision = frame_clock.vision
    vision.ids = _chosen_ids(scenario, options, vision.seen_ids())
    frame_clock.choose_source(options.pace)
    radio_type = SimulatorRadio if options.radio is None else _find_radio(options.radio)
    with closing(radio_type(options.sender_config, vision.messages)) as radio:
        chosen = _with_measured(
            _displaced(scenario, vision.median_poses()), options, vision.noise()
        )
        if options.pulse and not options.is_overridden(DEAD_TIME):
            settle_s = chosen.settings.reference.settle_s + PULSE_S
            longer = chosen.settings.replace(reference={"settle_s": settle_s})
            trial = Live(chosen.replace(settings=longer), frame_clock, radio)
            radio_settings = {"kind": "fixed", "delay_frames": _dead_time(trial)}
            chosen = chosen.replace(settings=chosen.settings.replace(radio=radio_settings))
        max_frames = (
            np.inf if options.duration_s is None else round(options.duration_s * FRAME_RATE_HZ)
        )
        live = Live(chosen, frame_clock, radio, max_frames)
        live.team.step(vision.median_poses())  # run slow first-call code before the robots wait
        live.reset()
        try:
            yield live
        finally:
            live.stop()


def _dead_time(trial: Live) -> float:
    """Measure the dead time with a pulse: latency minus the lag of the wheel loops, frames.

    Raises:
        OmniError: A robot does not respond.
    """
    try:
        fits = measure_pulse(trial)
    finally:
        trial.stop()
    unresponsive = [
        str(number)
        for number, fit in zip(trial.ids, fits, strict=True)
        if fit is None or fit.alpha < MIN_ALPHA
    ]
    if unresponsive:
        cameras = sorted(trial.frame_clock.vision.cameras.items())
        problems = [
            f"; camera {n}: {camera.age_problem}" for n, camera in cameras if camera.age_problem
        ]
        raise OmniError(
            f"robots {', '.join(unresponsive)} were not seen to turn as commanded; check --team and"
            f" --commands, or skip this test with --no-pulse{''.join(problems)}"
        )
    latency = float(np.median([fit.latency_frames for fit in fits if fit]))
    trial.messages.add("pulse", f"latency measured by a pulse: {format_latency(latency)}")
    lag_frames = trial.scenario.settings.control.assumed_lag_s * FRAME_RATE_HZ
    return max(round(latency - lag_frames, 2), 0.0)


def _with_measured(
    scenario: Scenario, options: ConnectionOptions, measured: Mapping[str, float]
) -> Scenario:
    """Return the scenario with measured values of settings that the user does not fix."""
    values = {
        name: value
        for name, value in measured.items()
        if not options.is_overridden(name) and np.isfinite(value)
    }
    return scenario.replace(settings=distributions.replace_values(scenario.settings, values))


def _chosen_ids(
    scenario: Scenario, options: ConnectionOptions, detected_ids: Sequence[int]
) -> list[int]:
    """Return the numbers of the robots to drive."""
    n_robots = len(scenario.settings.world.start_poses)
    ids = list(options.ids) or list(detected_ids[:n_robots])
    undetected = ", ".join(str(number) for number in ids if number not in detected_ids)
    if undetected or not ids or (len(ids) < n_robots and not options.ids):
        robots = f"{format_count(n_robots, 'robot')} for the scenario"
        if undetected:
            robots = f"robots {undetected}"
        raise OmniError(
            f"vision does not detect {robots}; {options.color} robots that it detects: "
            f"{', '.join(map(str, detected_ids)) or 'none'}. Check --team and --id"
        )
    return ids


def _displaced(scenario: Scenario, poses: Array) -> Scenario:
    """Return the scenario with start poses that let references start at the robots' poses."""
    reference_start = reference_factory.build_timed_reference(scenario.settings).poses[0]
    turn = wrap_angle(poses[:, 2] - reference_start[2])
    start_poses = poses - body_to_world(reference_start, turn)
    start_poses[:, 2] = turn
    return scenario.replace(
        settings=scenario.settings.replace(world={"start_poses": start_poses.tolist()})
    )


def _find_radio(name: str) -> type[TeamRadio]:
    """Return the class of a radio of the user's own.

    Raises:
        OmniError: There is no such class.
    """
    if not plugins.is_class_path(name):
        raise OmniError(f"--radio must be file.py:Class, got {name!r}")
    return plugins.load_class(
        name,
        "derived from omni_mj.live.team_radio.TeamRadio",
        lambda kind: issubclass(kind, TeamRadio),
    )

"""How the law is fitted to one kind of inputs: what is free, what is left out, and what else is tried at a misfit."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.robot.motors import Motor
from omni_mj.scenarios.settings import PERIOD_S, Settings
from omni_mj.studies.identify import axes, jitter, law, suspects, wheels
from omni_mj.studies.identify.findings import DRIVES_M_S, TURNS_RAD_S, Estimate, Excitation, estimates
from omni_mj.studies.identify.fit import Fit, fit
from omni_mj.studies.identify.logs import Log
from omni_mj.studies.identify.predict import Prediction, predict
from omni_mj.studies.identify.segments import SEGMENT_S, Segments, cut

LEAST_STRETCHES = 4
ODD, MOST_ODD = 3.0, 0.25  # residuals over their median, and share, of stretches that may be left out
EARLIEST_S = -0.25  # clocks of wheels that are tried
DRIFTS_S = 30.0  # length of logs from which clocks may run at other speeds
OTHER_RADIUS, SURE = 0.025, 3.0  # and standard errors, from which the wheels are of another radius than the file's
ROLLS, RADIUS_SHARE = 0.9988, 0.002  # rolling radius over the file's (rubber is pressed in), and how well it is known
ROLLING_M_S = 0.05  # speed of rims above which motors without current roll out, and do not stand
BETTER = 0.98  # residuals over those without, by which another cause must be better
CONTACTS = ("creep", "pile", "roller_friction", "lean_x_m_s2", "lean_y_m_s2")
INTEGRAL_1_S = 5.0  # of loops, to try: 3 V/rad beside 0.6 V s/rad


@dataclass
class Part:
    """The fit to one kind of inputs.

    Attributes:
        source: commands or wheels.
        fitted: to `segments`.
        prediction: of those that were held out, or None where there are too few.
        estimates: numbers, told or not.
        notes: what was seen on the way.
        odd: a wheel that is not as the others, in a line.
    """

    source: str
    fitted: Fit
    segments: Segments
    prediction: Prediction | None
    estimates: list[Estimate] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    odd: list[str] = field(default_factory=list)


def by_wheels(logs: Sequence[Log], settings: Settings) -> Part | None:
    """Fit to wheels; None where the robot stands still.

    Raises:
        OmniError: wheels are not this robot's, axes are others than said, or there is too little.
    """
    body, notes = law.Body.of(settings), list[str]()
    twists = [wheels.twists(log, settings) for log in logs]
    late = np.array([_late(log, twist, True, "wheels") for log, twist in zip(logs, twists, strict=True)])
    speeds = [log.wheels for log in logs if log.wheels is not None]
    segments = _cut(logs, speeds, [True] * len(logs), True)
    if _stands(twists, "wheels", notes):
        return None
    used, held = segments.held_out()
    believed = of_wheels(settings)
    always = ["scale", "arm", "compass_rad"]
    start = believed.copy()
    if max(log.time[-1] - log.time[0] for log in logs) > DRIFTS_S:
        start[law.DRIFT] = np.median([_drift(log, twist) for log, twist in zip(logs, twists, strict=True)])
        always.append("drift")
    nothing = dict.fromkeys(CONTACTS, 0.0)
    first = fit(body, used, start, late, always, nothing, rough=True)
    given, free, fixed = "", always, nothing
    if Excitation.of(first, used).creeps.any():
        free, fixed = [*CONTACTS, *always], {}
        start = believed.copy()
        at = [law.NAMES.index(name) for name in always]
        start[at] = first.parameters[at]
        first = fit(body, used, start, first.late, free)
    else:
        first = fit(body, used, first.parameters, first.late, always, nothing)
        given = "it needs faster moves"
        notes.append("wheels: too slow for creep; what creeps under drag is in radius and gains")
    found, used = _usual(body, used, first, free, fixed, notes, "wheels", logs)
    if found.misfit and given == "":
        wider = fit(body, used, found.parameters, found.late, [*free, "grip"])
        if _better(wider, found):
            notes.append(f"wheels: they slide; with friction of {wider.parameters[law.GRIP]:.2f} residuals are smaller")
            found = wider
    if given == "":
        found = _believing_the_radius(found, notes)
    prediction = None
    if len(held):
        lates = np.stack([np.zeros(len(held)), found.late[held.log if len(found.late) > 1 else 0 * held.log]], 1)
        prediction = predict(body, held, np.stack([believed, found.parameters]), lates)
    told = list(estimates(found, body, settings, used, given))
    odd = [] if given else list(suspects.odd_rims(found, body, used))  # without creep another cause is as likely
    return Part("wheels", found, used, prediction, told, notes, odd)


def by_commands(logs: Sequence[Log], settings: Settings, rolled: Fit | None) -> Part | None:
    """Fit to commands; None where the robot stands still.

    Args:
        logs: with commands.
        settings: of the start robot.
        rolled: what wheels told of creep and drag, which is not fitted again; or None.

    Raises:
        OmniError: axes are others than said, or there is too little.
    """
    body, notes = law.Body.of(settings), list[str]()
    logs = [_driven(log, settings.wheels.radius_m) for log in logs]
    inputs = [log.command for log in logs if log.command is not None]
    looks = [_late(log, u, log.in_body, "commands") for log, u in zip(logs, inputs, strict=True)]
    segments = _cut(logs, inputs, [log.in_body for log in logs], False)
    if _stands(inputs, "commands", notes):
        return None
    used, held = segments.held_out()
    believed = of_commands(settings)
    start = believed.copy()
    lag = 2 * believed[law.GIVE] / len(body.outward)
    late = np.array([max(float(np.median(looks)) - lag, 0.01)])
    free, given = ["scale", "give_s", "friction_m_s", "compass_rad"], ""
    if np.sqrt((segments.inputs[:, 2] ** 2).mean()) > TURNS_RAD_S:
        free.append("turn_gain")
    if believed[law.INTEGRAL] > 0:
        free.append("integral_1_s")
    if rolled is not None:
        shared = [law.NAMES.index(name) for name in (*CONTACTS, "grip")]
        start[shared] = rolled.parameters[shared]
        start[law.ARM] = rolled.parameters[law.ARM] / rolled.parameters[law.SCALE]
        found = fit(body, used, start, late, free)
    else:
        found = fit(body, used, start, late, free, rough=True)
        if Excitation.of(found, used).creeps.any():
            free = [*CONTACTS, *free]
            found = fit(body, used, found.parameters, found.late, free)
        else:
            found = fit(body, used, start, late, free, dict.fromkeys(CONTACTS, 0.0))
            given = "it needs faster moves"
    whole = len(used)
    found, used = _usual(body, used, found, free, {}, notes, "commands", logs)
    if found.misfit and "integral_1_s" not in free:
        start = found.parameters.copy()
        start[law.SCALE], start[law.INTEGRAL], start[law.GIVE] = 0.9, INTEGRAL_1_S, believed[law.GIVE]
        wider = fit(body, used, start, found.late, [*free, "integral_1_s"])
        if _better(wider, found):
            notes.append("commands: wheel loops integrate, which the robot's file does not say")
            found = wider
    prediction = None
    if len(held):
        delay = settings.radio.delay_frames * PERIOD_S
        lates = np.tile([delay, found.late[0]], (len(held), 1))
        prediction = predict(body, held, np.stack([believed, found.parameters]), lates)
    told = [*estimates(found, body, settings, used, given), jitter.of_moves(found, used, whole - len(used))]
    odd = list(suspects.odd_loops(found, body, used)) if found.misfit else []
    return Part("commands", found, used, prediction, told, notes, odd)


def of_wheels(settings: Settings) -> Array:
    """Parameters as the start robot has them, with speeds of wheels for inputs."""
    start = dict.fromkeys(law.NAMES, 0.0) | {"scale": 1.0, "arm": 1.0, "grip": settings.carpet.friction}
    start["creep"] = 1 / settings.drive.creep_stiffness if settings.wheels.creep == "on" else 0.0
    start |= {"pile": settings.carpet.pile, "roller_friction": settings.drive.roller_friction}
    return np.append(np.array(list(start.values())), np.zeros(2 * len(settings.wheels.azimuths_deg)))


def of_commands(settings: Settings) -> Array:
    """Same, with commands for inputs: loops of PI and feed-forward on motors by their datasheet.

    A wheel that lags by e gets the torque (k_p + k) e + k_i integral of e - (1 - f) k u, times k / (R resistance).
    """
    start, motor, firmware = of_wheels(settings), Motor.of(settings.motor), settings.firmware
    constant, radius = motor.speed_constant, settings.wheels.radius_m
    gain = firmware.kp + constant
    stiffness = constant * gain / (motor.resistance * radius**2)
    start[law.GIVE] = settings.body.mass_kg / stiffness
    start[law.FRICTION] = (settings.drive.gear_friction_nm + motor.wheel_dry) / radius / stiffness
    start[law.SCALE] = 1 - (1 - firmware.feed_forward) * constant / gain
    start[law.TURN], start[law.INTEGRAL] = firmware.turn_gain, firmware.ki / gain
    return start


def _believing_the_radius(found: Fit, notes: list[str]) -> Fit:
    """What follows if wheels roll as their radius says, which is as well known; a fit, where it says otherwise.

    Drag that passes through creep takes a share of the speed, as a smaller radius does; what the data know of both
    together, and the file of one, is both (Gauss's rule for adding an observation).
    """
    at = found.names.index("scale")
    scale, error = found.value[at], found.error[at]
    if abs(scale - 1) > max(SURE * error, OTHER_RADIUS):
        notes.append(f"wheels: their radius is not that of the robot's file: {100 * (scale - 1):+.1f} %")
        return found
    notes.append(
        f"wheels: the file's radius is believed within {100 * RADIUS_SHARE:.1f} %; without it, it were "
        f"{100 * (scale - 1):+.1f} +- {100 * error:.1f} %, and drag with it"
    )
    gain = found.covariance[at] / (error**2 + RADIUS_SHARE**2)
    value = found.value + gain * (ROLLS - scale)
    covariance = found.covariance - np.outer(gain, found.covariance[at])
    parameters, count = found.parameters.copy(), len(found.late)
    parameters[[law.NAMES.index(name) for name in found.names[count:]]] = value[count:]
    return replace(found, value=value, covariance=covariance, parameters=parameters, late=value[:count])


def _cut(logs: Sequence[Log], inputs: Sequence[Array], in_body: Sequence[bool], are_wheels: bool) -> Segments:
    segments = cut(logs, inputs, in_body, are_wheels)
    if len(segments) < LEAST_STRETCHES:
        raise OmniError(
            f"{len(segments)} stretches of {SEGMENT_S:g} s without a gap are too few to identify anything; "
            f"at least {LEAST_STRETCHES}"
        )
    return segments


def _stands(twists: Sequence[Array], source: str, notes: list[str]) -> bool:
    """Whether a robot neither drives nor turns."""
    whole = np.concatenate(twists)
    speed, rate = np.sqrt((whole[:, :2] ** 2).sum(1).mean()), np.sqrt((whole[:, 2] ** 2).mean())
    return bool(speed < DRIVES_M_S / 2 and rate < TURNS_RAD_S / 2)


def _driven(log: Log, radius: float) -> Log:
    """A log without poses where its robot rolls out, whatever is commanded."""
    if log.motors is None or log.motors.coasting is None or log.wheels is None:
        return log
    rolls = log.motors.coasting & (np.abs(log.wheels).max(1) * radius > ROLLING_M_S)
    return replace(log, pose=np.where(rolls[:, None], np.nan, log.pose))


def _late(log: Log, inputs: Array, in_body: bool, source: str) -> float:
    return axes.look(log, inputs, in_body, source, EARLIEST_S if source == "wheels" else 0.0).delay


def _drift(log: Log, twists: Array) -> float:
    """By how much clocks of wheels are slower: of delays in the first and last third; 0 within what they show."""
    third = len(log.time) // 3
    if third < 100:
        return 0.0
    delays = []
    for part in (slice(0, third), slice(len(log.time) - third, None)):
        try:
            delays.append(axes.look(log.part(part), twists[part], True, "wheels", 2 * EARLIEST_S).delay)
        except OmniError:
            return 0.0
    change, apart = delays[1] - delays[0], log.time[-third // 2] - log.time[third // 2]
    return float(change / apart) if abs(change) > 2 * log.period else 0.0


def _usual(
    body: law.Body,
    used: Segments,
    first: Fit,
    free: Sequence[str],
    fixed: Mapping[str, float],
    notes: list[str],
    source: str,
    logs: Sequence[Log],
) -> tuple[Fit, Segments]:
    """A fit without stretches that are odd, where the first one has some, and those that it is to."""
    found = first
    usual = found.each <= ODD * np.median(found.each)
    if not usual.all() and usual.mean() >= 1 - MOST_ODD and usual.sum() >= LEAST_STRETCHES:
        odd = list(_where(used.some(~usual), logs))
        notes.append(
            f"{source}: {len(odd)} of {len(used)} stretches with residuals of over {ODD:g} times the median are left "
            f"out: {', '.join(odd[:4])}{', ...' if len(odd) > 4 else ''}; wheels that slide, a push, or a camera's "
            "mistake"
        )
        used = used.some(usual)
        found = fit(body, used, found.parameters, found.late, free, fixed)
    return found, used


def _better(wider: Fit, found: Fit) -> bool:
    """Whether another cause makes residuals smaller."""
    return bool((wider.each**2).mean() < BETTER**2 * (found.each**2).mean())


def _where(segments: Segments, logs: Sequence[Log]) -> Iterator[str]:
    """The log, and the time since its first line, at which each stretch begins."""
    begun = segments.clock[segments.begins[segments.log]]
    for log, t in zip(segments.log, segments.time[:, 0] - begun, strict=True):
        yield f"{logs[log].name} at {t:.1f} s"

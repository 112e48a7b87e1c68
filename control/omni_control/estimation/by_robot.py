"""Identification by loops over robots, for a compiler: what `Identifier` and `Turning` do by numpy.

Each robot is reckoned by itself, by the same laws (`evidence`, `motion`, `turning`): some thousand multiplications,
where numpy makes hundreds of calls. Uncompiled they give the same, slowly. Numpy and these round otherwise.
"""

from typing import NamedTuple

import numpy as np

from omni_control.estimation import evidence
from omni_control.estimation.arrays import GivesArrays, LateArrays, PlantArrays, TurningArrays
from omni_control.estimation.hearsay import condition
from omni_control.estimation.motion import fading
from omni_control.estimation.turning_by_robot import carry, pulled, turned, within
from omni_control.kinematics import Array

LEAST_S = 1e-9  # below which nothing acts


class Axes(NamedTuple):
    """What a robot's law is along its axes, forward and sideways; see `Motion`."""

    effort: tuple[float, float]
    still: tuple[float, float]
    slower: tuple[float, float]
    rubbed: tuple[float, float]
    gives: tuple[float, float]


class Gone(NamedTuple):
    """`motion.Step` of one robot, by axes."""

    before: tuple[float, float]
    moved: tuple[float, float]
    velocity: tuple[float, float]
    decay: tuple[float, float]
    carried: tuple[float, float]
    rubbing: tuple[float, float]


def identify(
    t: TurningArrays,
    p: PlantArrays,
    g: GivesArrays,
    late: LateArrays,
    frame: int,
    reported: bool,
    measured: Array,
    sent: Array,
) -> None:
    """Take in a frame.

    Args:
        t: headings; written.
        p: positions; written.
        g: how wheels give way.
        late: how far filters are behind.
        frame: number of frames taken in before of which vision reported.
        reported: whether this is one; no more than a step on the way to it otherwise.
        measured: poses seen (n, 3), not a number where a robot was not seen.
        sent: commands up to the frame before, (count, n, 3).
    """
    count = len(sent)
    for i in range(len(measured)):
        behind, held, after = late.behind[i], late.held[i], late.after[i]
        state, law, heading = p.state[i], axes(i, p), t.state[i, 0]
        velocity, push = complex(state[2], state[3]), complex(state[4], state[5])
        latency, compass = p.delay + state[12] + behind, np.exp(-1j * state[6])
        acting, turn, early, belated, hurried, delayed = 0j, 0.0, 0j, 0j, 0.0, 0.0
        spread = evidence.spread(p.variance[i, 12, 12])
        sooner, later = max(latency - spread, 0.0), latency + spread
        for j in range(count):
            command, since = complex(sent[j, i, 0], sent[j, i, 1]), float(count - 1 - j)
            share = max(1 - abs(latency - since), 0.0)
            acting += share * command
            turn += share * sent[j, i, 2]
            if_sooner, if_later = max(1 - abs(sooner - since), 0.0), max(1 - abs(later - since), 0.0)
            early += if_sooner * command
            belated += if_later * command
            hurried += if_sooner * sent[j, i, 2]
            delayed += if_later * sent[j, i, 2]
        arrived = acting * compass
        back = np.exp(-1j * heading)
        shortfall = (arrived - velocity) * back
        turn += pulled(g, velocity * back, t.state[i, 1], p.gained[i], shortfall, state[13], t.creep[i])
        facing, sliding = measured[i, 2] if reported else np.nan, p.sliding[i]
        delaying = (delayed - hurried) / (later - sooner)
        longer, left = turned(i, t, held, after, facing, turn, abs(velocity), shortfall, sliding, delaying)

        middle = np.exp(1j * ((heading + t.state[i, 0]) / 2))
        gone = step(law, velocity, arrived + push, middle, p.period)
        unaided = velocity
        if not held:
            p.gained[i] = complex(gone.velocity[0] - gone.before[0], gone.velocity[1] - gone.before[1]) / p.period
            change = (belated - early) / (later - sooner) * compass
            passed(i, p, law, gone, arrived, change, middle, velocity)
            for k in range(14):
                if k < 2 or k > 3:
                    state[k] = p.kept[k] * state[k] + p.renewed[k]
            moved, unaided = world(gone.moved, middle), world(gone.velocity, middle)
            state[0] += moved.real
            state[1] += moved.imag
            state[2], state[3] = unaided.real, unaided.imag
        condition(state, p.variance[i], 12, longer, left)
        if reported:
            place = complex(measured[i, 0], measured[i, 1]) - after * unaided
            doubt(i, p, place)
            corrected(i, p, place, after)
            felt(i, p, frame, velocity, unaided, arrived)
        longer, left = state[12] - t.state[i, 8], p.variance[i, 12, 12] / t.variance[i, 8, 8]
        condition(t.state[i], t.variance[i], 8, longer, left)
        t.state[i, 8], t.variance[i, 8, 8] = state[12], p.variance[i, 12, 12]
        within(t.state[i], 3, t.least, t.most)


def axes(i: int, p: PlantArrays) -> Axes:
    """The law of a robot."""
    state, gives = p.state[i], (p.gives[0], p.gives[1])
    effort = state[7], state[8]
    still = state[13] * gives[0] / effort[0], state[13] * gives[1] / effort[1]
    rubbed = state[11] * gives[0] / effort[0], state[11] * gives[1] / effort[1]
    return Axes(effort, still, (effort[0] * state[9], effort[1] * state[10]), rubbed, gives)


def world(pair: tuple[float, float], heading: complex) -> complex:
    """A vector of a robot's axes in the world's."""
    return complex(pair[0], pair[1]) * heading


def step(law: Axes, velocity: complex, command: complex, heading: complex, duration: float) -> Gone:
    """See `Motion.step`."""
    back = heading.conjugate()
    v, u, speed = velocity * back, command * back, abs(velocity)
    late_0, late_1 = law.still[0] + law.slower[0] * speed, law.still[1] + law.slower[1] * speed
    decay_0, decay_1 = np.exp(-duration / late_0), np.exp(-duration / late_1)
    rest_0, rest_1 = 1 - decay_0, 1 - decay_1
    towards_0, towards_1 = u.real / law.effort[0], u.imag / law.effort[1]
    free_0, free_1 = v.real + rest_0 * (towards_0 - v.real), v.imag + rest_1 * (towards_1 - v.imag)
    size = abs(complex(free_0, free_1))
    along_0 = free_0 / fading(size, rest_0 * law.rubbed[0])
    along_1 = free_1 / fading(size, rest_1 * law.rubbed[1])
    final_0, final_1 = towards_0 - law.rubbed[0] * along_0, towards_1 - law.rubbed[1] * along_1
    over_0, over_1, carried = v.real - final_0, v.imag - final_1, (rest_0 * late_0, rest_1 * late_1)
    moved = duration * final_0 + over_0 * carried[0], duration * final_1 + over_1 * carried[1]
    after = final_0 + over_0 * decay_0, final_1 + over_1 * decay_1
    rubbing = law.gives[0] * along_0, law.gives[1] * along_1
    return Gone((v.real, v.imag), moved, after, (decay_0, decay_1), carried, rubbing)


def passed(
    i: int, p: PlantArrays, law: Axes, gone: Gone, arrived: complex, later: complex, heading: complex, velocity: complex
) -> None:
    """The variance after a step; see `Identifier._passed_on`."""
    back, acts, maps = heading.conjugate(), np.empty(12, np.complex128), np.empty((4, 12))
    change_0, change_1 = (gone.before[0] - gone.velocity[0]) / p.period, (gone.before[1] - gone.velocity[1]) / p.period
    speed = abs(velocity)
    shown = evidence.evident(speed)
    obeys = evidence.obeys(shown, p.sliding[i], p.surprise[i])
    creeps = evidence.creeps(shown, speed, idles(i, p, arrived))
    acts[0] = acts[2] = back
    acts[1] = acts[3] = 1j * back
    acts[4] = -1j * arrived * back * obeys
    acts[5] = complex((gone.before[0] + gone.velocity[0]) / -2 * obeys, 0.0)
    acts[6] = complex(0.0, (gone.before[1] + gone.velocity[1]) / -2 * obeys)
    acts[7] = complex(law.effort[0] ** 2 * creeps * change_0, 0.0)
    acts[8] = complex(0.0, law.effort[1] ** 2 * creeps * change_1)
    acts[9] = -complex(gone.rubbing[0], gone.rubbing[1]) * obeys
    acts[10] = later * back * obeys
    acts[11] = complex(change_0 * law.gives[0], change_1 * law.gives[1]) * obeys
    for k in range(12):
        lasting = k >= 2  # what is no velocity acts all the while
        for row in range(2):
            left = gone.decay if row else gone.carried
            whole = 1.0 if row else p.period
            one = (whole - left[0]) / law.effort[0] if lasting else left[0]
            other = (whole - left[1]) / law.effort[1] if lasting else left[1]
            driven = complex(acts[k].real * one, acts[k].imag * other) * heading
            maps[2 * row, k], maps[2 * row + 1, k] = driven.real, driven.imag
    carry(p.variance[i], maps, p.kept)
    variance = p.variance[i]
    for j in range(6, 14):
        for k in range(6, 14):
            variance[j, k] += p.forget[j, k]
    doubted = evidence.doubted(p.sliding[i], abs(complex(change_0, change_1)))
    usual = evidence.restless(p.surprise[i])
    for j in range(4):
        variance[2 + j, 2 + j] += usual * p.restless[j] * (1 + doubted**2 if j < 2 else 1.0)


def idles(i: int, p: PlantArrays, arrived: complex) -> bool:
    """See `Identifier._idles`."""
    idle: bool = evidence.idles(p.lacks[0, i], p.lacks[1, i], arrived, p.seen[1, i] / p.period)
    return idle


def doubt(i: int, p: PlantArrays, place: complex) -> None:
    """See `Identifier._doubt`."""
    first = place - p.seen[0, i]
    second = first - p.seen[1, i]
    change = evidence.noisier(p.noise[i], abs(second - p.seen[2, i]) ** 2 / 40)
    if not np.isnan(change):
        p.noise[i] += change
    p.seen[0, i], p.seen[1, i], p.seen[2, i] = place, first, second


def corrected(i: int, p: PlantArrays, place: complex, after: float) -> None:
    """Correct by what vision reports; see `Identifier._correct`."""
    state, variance, of = p.state[i], p.variance[i], np.empty((2, 14))
    if np.isnan(place.real) or np.isnan(place.imag):
        within(state, 6, p.lowest, p.highest)
        return
    for j in range(2):
        for k in range(14):
            of[j, k] = variance[j, k] + after * variance[2 + j, k]
    noise = max(p.noise[i], p.told)
    xx, yy = of[0, 0] + after * of[0, 2] + noise, of[1, 1] + after * of[1, 3] + noise
    xy, yx = of[0, 1] + after * of[0, 3], of[1, 0] + after * of[1, 2]
    area = xx * yy - xy * yx
    x, y = place.real - state[0], place.imag - state[1]
    weigh_x, weigh_y = (x * yy - y * yx) / area, (y * xx - x * xy) / area
    surprise = (x * weigh_x + y * weigh_y) / 2
    p.surprise[i] = evidence.surprised(p.surprise[i], surprise)
    far = abs(complex(x, y))
    if evidence.carried(surprise, far, p.period):
        state[0] += x
        state[1] += y
        within(state, 6, p.lowest, p.highest)
        set_down(variance, far, noise, p.period)
        return
    for k in range(14):
        state[k] += weigh_x * of[0, k] + weigh_y * of[1, k]
    within(state, 6, p.lowest, p.highest)
    for j in range(14):
        gain_x, gain_y = (of[0, j] * yy - of[1, j] * yx) / area, (of[1, j] * xx - of[0, j] * xy) / area
        for k in range(j, 14):
            variance[j, k] -= gain_x * of[0, k] + gain_y * of[1, k]
            variance[k, j] = variance[j, k]


def set_down(variance: Array, far: float, noise: float, period: float) -> None:
    """Change the variance (14, 14) of a robot that was put `far` from where it was expected, m; see `evidence.carried`.

    It is where it is seen, but for the noise, of a variance in m^2. How fast it is, which could have led as far in a
    frame, the next image tells. Nothing else is known better than before.
    """
    variance[:2] = 0.0
    variance[:, :2] = 0.0
    for j in range(2):
        variance[j, j] = noise
        variance[2 + j, 2 + j] += (far / period) ** 2


def felt(i: int, p: PlantArrays, frame: int, before: complex, unaided: complex, arrived: complex) -> None:
    """Find whether wheels slide; see `Identifier._felt`."""
    state, was = p.state[i], p.sliding[i]
    asked = evidence.lacking(p.lacks[0, i], (unaided - before) / p.period)
    missing = evidence.lacking(p.lacks[1, i], (unaided - complex(state[2], state[3])) / p.period)
    p.lacks[0, i], p.lacks[1, i] = asked, missing
    slides = evidence.slides(asked, missing)
    p.lasts[i] = evidence.lasting(p.lasts[i], slides, idles(i, p, arrived), p.period)
    p.sliding[i] = now = evidence.believed(was, slides, p.lasts[i], p.ends)
    frames = len(p.past)
    begins, oldest = was < 0.5 <= now, (frame + 1) % frames if frame >= frames else 0
    for k in range(8):
        p.past[frame % frames, i, k] = state[6 + k]
        if begins:
            state[6 + k] = p.past[oldest, i, k]

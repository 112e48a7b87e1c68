"""One robot of a game log: chosen by team and number, seen by one camera after the other, with its commands or without.

Cameras that overlap do not agree: each is calibrated by itself, and they differ by centimetres. So a robot is followed
in one camera as long as that sees it; at a change of cameras, what both saw of it tells their difference, by which the
positions of the second are shifted. Where nothing was seen by both the log is cut.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array, wrap_angle
from omni_mj.studies.identify.game_log import TEAMS, Sightings, read

HOLD = 3.5  # periods of a camera without a robot, from which on another takes over
OVERLAP_S, LEAST_SHARED = 0.5, 3  # how near to a change, and how often, two cameras must both have seen it
FASTEST_M_S, NEAR_M = 10.0, 0.05  # how far a robot may be from where it was just seen
TRIES = 5  # sightings elsewhere in a row, from which on it is believed to be there
BREAK_S = 1.0  # put between what does not belong together
LEAST_S = 1e-3  # between two images: nearer ones are one, recorded twice
AGREE_M = 2e-3  # differences of cameras that are not worth a word


@dataclass(frozen=True)
class Track:
    """A robot over time.

    Attributes:
        time: of each line, (F,) s of the log's clock.
        pose: (F, 3).
        cuts: lines before which it is not known where the robot came from.
        notes: a line each.
    """

    time: Array
    pose: Array
    cuts: list[int]
    notes: list[str]


def track(path: Path, team: str | None, number: int | None) -> tuple[str, Track]:
    """Follow a robot.

    Args:
        path: of the game log.
        team: yellow or blue.
        number: of the robot. Without both, the log must hold one robot only.

    Returns:
        What it is called, and where it was.

    Raises:
        OmniError: the log cannot be read, or holds another robot, or several where none is named.
    """
    seen = read(path)
    there = sorted({(int(t), int(r)) for t, r in np.unique(np.column_stack([seen.team, seen.robot]), axis=0)})
    chosen = [(t, r) for t, r in there if (team is None or TEAMS[t] == team) and (number is None or r == number)]
    if len(chosen) != 1:
        moves = "; ".join(f"{TEAMS[t]} {r} {_told(seen.of(t, r))}" for t, r in there)
        asked = " ".join(str(word) for word in (team, number) if word is not None)
        what = f"{'several are' if chosen else 'there is no'} {asked}" if asked else "which robot is meant"
        example = "yellow:3" if not there else f"{TEAMS[there[0][0]]}:{there[0][1]}"
        raise OmniError(
            f"{path.name}: {what}; name one, as {path.name}:{example}, or --team and --id; it holds {moves or 'none'}"
        )
    (one,) = chosen
    name = f"{path.name} ({TEAMS[one[0]]} {one[1]})"
    return name, _followed(seen.of(*one), name)


def _told(seen: Sightings) -> str:
    """How long a robot is seen, and how far it goes: steps of 0.2 s that are longer than noise."""
    order = np.argsort(seen.time)
    time, position = seen.time[order], seen.pose[order, :2]
    steps = np.unique(np.searchsorted(time, np.arange(time[0], time[-1] + 1e-9, 0.2)))
    lengths = np.hypot(*np.diff(position[steps], axis=0).T)
    return f"moves {lengths[lengths > 0.02].sum():.1f} m in {time[-1] - time[0]:.0f} s"


def _followed(seen: Sightings, name: str) -> Track:
    order = np.argsort(seen.time, kind="stable")
    time, pose, camera = seen.time[order], seen.pose[order], seen.camera[order].astype(int)
    periods = {c: float(np.median(np.diff(times))) for c, times in seen.images.items() if len(times) > 1}
    kept, cuts, notes = list[int](), list[int](), list(seen.notes)
    shift, shifts = np.zeros(2), list[Array]()
    elsewhere, differ, again = 0, dict[tuple[int, int], float](), _again(time, camera)
    for i in range(len(time)):
        if kept:
            last = kept[-1]
            if time[i] - time[last] < LEAST_S:
                continue
            known, now = camera[last], camera[i]
            if now != known:
                if again[last] - time[last] <= HOLD * periods.get(known, 0.02):
                    continue
                between = _difference(time, pose, camera, known, now, time[i])
                if between is None:
                    cuts.append(len(kept))
                else:
                    shift = shift - between
                    differ[known, now] = max(differ.get((known, now), 0.0), float(np.hypot(*between)))
            else:
                moved = np.hypot(*(pose[i, :2] + shift - pose[last, :2] - shifts[-1]))
                if moved > FASTEST_M_S * (time[i] - time[last]) + NEAR_M:
                    elsewhere += 1
                    if elsewhere < TRIES:
                        continue
                    cuts.append(len(kept))
        elsewhere = 0
        kept.append(i)
        shifts.append(shift)
    whole = pose[kept].copy()
    whole[:, :2] += np.array(shifts).reshape(-1, 2)
    for (a, b), far in differ.items():
        if far > AGREE_M:
            notes.append(f"{name}: cameras {a} and {b} differ by up to {1e3 * far:.0f} mm; the second is shifted")
    if cuts:
        notes.append(f"{name}: {len(cuts)} times it is not known where it came from; the log is cut there")
    return Track(time[kept], whole, cuts, notes)


def _again(time: Array, camera: Array) -> Array:
    """When the camera of each sighting sees the robot the next time; infinite where it never does."""
    again = np.full(len(time), np.inf)
    for one in np.unique(camera):
        own = np.flatnonzero(camera == one)
        again[own[:-1]] = time[own[1:]]
    return again


def _difference(time: Array, pose: Array, camera: Array, one: int, other: int, when: float) -> Array | None:
    """By how much positions of one camera are off another's (2,), where both saw the robot; None where they did not."""
    near = np.abs(time - when) <= OVERLAP_S
    first, second = np.flatnonzero(near & (camera == one)), np.flatnonzero(near & (camera == other))
    if len(first) < 2 or not len(second):
        return None
    at = time[second]
    after = np.clip(np.searchsorted(time[first], at), 1, len(first) - 1)
    close = (at >= time[first][0]) & (at <= time[first][-1])
    close &= time[first][after] - time[first][after - 1] < 3 * np.median(np.diff(time[first]))
    if close.sum() < LEAST_SHARED:
        return None
    seen = [np.interp(at[close], time[first], pose[first, axis]) for axis in range(2)]
    return np.asarray(np.median(pose[second[close], :2] - np.stack(seen, axis=1), axis=0))


def with_commands(found: Track, columns: Mapping[str, Array], names: tuple[str, ...], file: str) -> tuple[Track, Array]:
    """A track where commands are known, and the mean of what was commanded from each line to the next, (F, 3).

    Args:
        found: the robot.
        columns: of the file of commands; each acts until the next.
        names: of the columns of commands.
        file: named in messages.

    Raises:
        OmniError: their clocks have nothing in common.
    """
    sent, values = columns["time_s"], np.stack([columns[name] for name in names], axis=1)
    period = float(np.median(np.diff(found.time)))
    known = (found.time >= sent[0]) & (found.time + period <= sent[-1] + 0.1)
    if known.sum() < 2:
        raise OmniError(
            f"{file}: commands from {sent[0]:.3f} to {sent[-1]:.3f} s, but images from {found.time[0]:.3f} to "
            f"{found.time[-1]:.3f} s; time_s must be of the clock of vision, t_capture in s"
        )
    # What is held from one command to the next has an integral of straight lines.
    ends = np.append(sent, max(sent[-1], found.time[-1]) + 1.0)
    integral = np.concatenate([np.zeros((1, 3)), np.cumsum(values * np.diff(ends)[:, None], axis=0)])
    time = found.time[known]
    steps = np.append(np.diff(time), period)
    steps = np.minimum(steps, HOLD * period)  # not over a gap
    begin, end = (np.stack([np.interp(t, ends, each) for each in integral.T], axis=1) for t in (time, time + steps))
    first = int(np.argmax(known))
    cuts = [cut - first for cut in found.cuts if 0 < cut - first < len(time)]
    return Track(time, found.pose[known], cuts, found.notes), (end - begin) / steps[:, None]


def apart(found: Track) -> Array:
    """Times from 0 on, in which what does not belong together is a gap apart, (F,) s."""
    time = found.time - found.time[0]
    for cut in found.cuts:
        time[cut:] += BREAK_S
    return time


def seen_of(found: Track, name: str) -> list[str]:
    """What poses alone tell, and what they do not, in lines."""
    period = float(np.median(np.diff(found.time)))
    time, pose = found.time, found.pose
    # Of white noise the third difference has the variance 20; a jerk of 50 m/s^3 adds 0.2 mm at 60 Hz.
    steady = np.abs(np.convolve(np.diff(time), np.ones(3), "valid") - 3 * period) < 0.3 * period
    third = np.diff(np.column_stack([pose[:, :2], np.unwrap(pose[:, 2])]), 3, axis=0)[steady]
    if len(third) < 10:
        return [f"{name}: too few images in a row to tell anything"]
    noise = 1.4826 * np.median(np.abs(third), axis=0) / np.sqrt(20)
    lag = max(1, round(0.1 / period))
    steps = (time[2 * lag :] - time[: -2 * lag])[:, None]
    speeds = np.column_stack(
        [pose[2 * lag :, :2] - pose[: -2 * lag, :2], wrap_angle(pose[2 * lag :, 2] - pose[: -2 * lag, 2])]
    )
    fine = steps[:, 0] < 3 * lag * period
    speeds = (speeds / steps)[fine]
    fast, turning = np.quantile(np.hypot(speeds[:, 0], speeds[:, 1]), 0.99), np.quantile(np.abs(speeds[:, 2]), 0.99)
    return [
        f"{name}: poses alone: noise of {1e3 * noise[:2].mean():.2f} mm and {1e3 * noise[2]:.1f} mrad (standard "
        f"deviation), up to {fast:.2f} m/s and {turning:.1f} rad/s (99 %)",
        f"{name}: poses alone tell nothing of latency, gains, creep, lags or drag, as nobody knows whether motors "
        "drove, braked or rolled out; give commands: LOG,commands.csv",
    ]

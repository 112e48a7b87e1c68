r"""The law of command to motion, over actual times: many stretches with many sets of parameters at once.

It is that of `omni_control.estimation.motion`, per axis of the body, with lags of their own:

    (tau_i + g_i^2 T_i |v|) v'_i = u_i - c n_i - g_i v_i,        u = the input of `latency` ago, turned by -compass.

Inputs act from their line to the next. Between the times at which poses were measured, and inputs change, the law is
solved exactly with the lag of the step's middle; steps are 1/40 s at most. Turning is the same law along one axis,
without creep and friction.
"""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.studies.identify.segments import COARSEST_S, Segments

NAMES = (
    "latency_s",
    "effort_forward",
    "effort_sideways",
    "creep_forward_s2_m",
    "creep_sideways_s2_m",
    "lag_forward_s",
    "lag_sideways_s",
    "friction_m_s",
    "compass_rad",
)
TURNING = ("latency_s", "effort_turning", "lag_turning_s")
RUBBED_M_S = 0.05  # speed from which dry friction is all there
LEAST_LAG_S = 1e-3


class Steps:
    """The steps of S stretches, for one latency.

    Attributes:
        duration: (q, S) s; some are 0.
        act: line of the input that acts, (q, S).
        middle: times, (q, S) s.
        samples: after how many steps each sample is, (S, m).
    """

    def __init__(self, segments: Segments, latency: float) -> None:
        time, clock = segments.time, segments.clock
        begin, end = time[:, :1], time[:, -1:]
        low = np.searchsorted(clock, begin[:, 0] - latency)
        most = int((np.searchsorted(clock, end[:, 0] - latency) - low).max()) + 1
        switch = clock[np.minimum(low[:, None] + np.arange(most), len(clock) - 1)] + latency
        parts = max(1, int(np.ceil(segments.period / COARSEST_S)))
        between = [time[:, :-1] + (k / parts) * np.diff(time) for k in range(1, parts)]
        merged = np.concatenate([time, np.clip(switch, begin, end), *between], axis=1)
        order = np.argsort(merged, axis=1, kind="stable")
        edges = np.take_along_axis(merged, order, axis=1)
        self.samples = np.argsort(order, axis=1, kind="stable")[:, : time.shape[1]]
        self.duration = np.diff(edges).T.copy()
        self.middle = ((edges[:, 1:] + edges[:, :-1]) / 2).T
        line = np.searchsorted(clock, self.middle - latency, side="right") - 1
        self.act = np.maximum(line, segments.first)


def translate(segments: Segments, parameters: Array, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions less the first, and velocities along the body's axes, at all samples.

    Args:
        segments: S stretches.
        parameters: P sets (P, 9), in the order of `NAMES`.
        start: velocities at the first sample, world frame, (S, P) complex m/s.

    Returns:
        Two complex arrays (S, P, m), world frame in m, and body frame in m/s.
    """
    steps, which = _steps(segments, parameters[:, 0])
    duration = np.stack([s.duration for s in steps], -1)[..., which]
    middle = np.stack([s.middle for s in steps], -1)
    act = np.stack([s.act for s in steps], -1)
    ahead = np.exp(1j * np.interp(middle, segments.clock, segments.heading))
    inputs = segments.inputs[act] * np.where(segments.in_body[act], 1.0, ahead.conj())
    back, inputs = ahead.conj()[..., which], inputs[..., which] * np.exp(-1j * parameters[:, 8])
    effort, creep, tau = parameters[:, 1:3], parameters[:, 3:5], parameters[:, 5:7]
    slack, rubbed = effort**2 * creep, parameters[:, 7]
    into = np.concatenate([back[:1], back[1:] * back[:-1].conj()])
    targets, rates = _pairs(inputs), -duration[..., None] * effort
    ahead_of = targets / effort
    v = start.astype(complex)
    moved, along = np.zeros((2, len(duration) + 1, *v.shape), complex)
    along[0] = v * back[0]
    for i in range(len(duration)):
        v = v * into[i]
        before = _pairs(v)
        lag = np.maximum(tau + slack * np.abs(v)[..., None], LEAST_LAG_S)
        kept = np.exp(rates[i] / (2 * lag))  # half the step, without friction, to the speed in its middle
        lag = np.maximum(tau + slack * np.abs(_plane(kept * before + (1 - kept) * ahead_of[i]))[..., None], LEAST_LAG_S)
        kept = np.exp(rates[i] / lag)
        gained = (1 - kept) / effort
        free = kept * before + gained * targets[i]
        cost = rubbed[:, None] * gained
        size = np.maximum(np.abs(_plane(free))[..., None], np.maximum(RUBBED_M_S, cost))
        final = (targets[i] - rubbed[:, None] * free / size) / effort
        after = final + (before - final) * kept
        way = duration[i][..., None] * final + (lag / effort) * (before - after)
        v = _plane(after)
        moved[i + 1], along[i + 1] = _plane(way) * back[i].conj(), v
    return _sampled(np.cumsum(moved, 0), steps, which), _sampled(along, steps, which)


def turn(segments: Segments, parameters: Array, start: np.ndarray) -> tuple[Array, Array]:
    """Headings less the first, and turn rates, at all samples.

    Args:
        segments: S stretches.
        parameters: P sets (P, 3), in the order of `TURNING`.
        start: turn rates at the first sample, (S, P) rad/s.

    Returns:
        (S, P, m), rad and rad/s.
    """
    steps, which = _steps(segments, parameters[:, 0])
    duration = np.stack([s.duration for s in steps], -1)[..., which]
    target = segments.turns[np.stack([s.act for s in steps], -1)][..., which] / parameters[:, 1]
    lag = np.maximum(parameters[:, 2], LEAST_LAG_S) / parameters[:, 1]
    kept, w = np.exp(-duration / lag), start.astype(float)
    turned, rates = np.zeros((2, len(duration) + 1, *w.shape))
    rates[0] = w
    for i in range(len(duration)):
        after = target[i] + (w - target[i]) * kept[i]
        turned[i + 1], rates[i + 1] = duration[i] * target[i] + lag * (w - after), after
        w = after
    return _sampled(np.cumsum(turned, 0), steps, which), _sampled(rates, steps, which)


def _steps(segments: Segments, latencies: Array) -> tuple[list[Steps], np.ndarray]:
    """Steps of each latency, padded to as many, and which of them each set of parameters has."""
    different, which = np.unique(latencies, return_inverse=True)
    steps = [Steps(segments, float(latency)) for latency in different]
    most = max(len(s.duration) for s in steps)
    for s in steps:
        lacks = most - len(s.duration)
        s.duration = np.concatenate([s.duration, np.zeros((lacks, s.duration.shape[1]))])
        s.act, s.middle = (np.concatenate([a, np.repeat(a[-1:], lacks, 0)]) for a in (s.act, s.middle))
    return steps, which


def _sampled(values: np.ndarray, steps: list[Steps], which: np.ndarray) -> np.ndarray:
    """Of values (q + 1, S, P) those at samples, (S, P, m)."""
    index = np.stack([s.samples for s in steps], 1)[:, which]
    return np.take_along_axis(values.transpose(1, 2, 0), index, axis=2)


def _pairs(vector: np.ndarray) -> Array:
    return np.ascontiguousarray(vector).view(float).reshape(*vector.shape, 2)


def _plane(pairs: Array) -> np.ndarray:
    return np.ascontiguousarray(pairs).view(complex)[..., 0]

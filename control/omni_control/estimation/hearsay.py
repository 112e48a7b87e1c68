"""What one filter takes in of what another has learned of a parameter that both estimate, for arrays and for loops.

Two filters whose errors have nothing in common but that parameter are one filter of both: each, told how the other's
estimate of it moved and how much of its variance is left, changes whatever goes along with it by as much as their
covariance says.
"""

from omni_control.kinematics import Array


def conditioned(state: Array, variance: Array, at: int, longer: Array, left: Array) -> tuple[Array, Array]:
    """States (n, m) and variances (n, m, m), if of the one at `at` is heard that it is larger, (n,), by as much.

    Args:
        state: (n, m).
        variance: (n, m, m).
        at: number of the state that both filters have.
        longer: by how much more it is than was thought, (n,).
        left: share of its variance that is left, (n,).
    """
    own = variance[:, at, at]
    share = variance[:, at] / own[:, None]
    less = ((1 - left) * own)[:, None, None]
    return state + share * longer[:, None], variance - share[:, :, None] * share[:, None] * less


def condition(state: Array, variance: Array, at: int, longer: float, left: float) -> None:
    """The same of one robot, a state (m,) and its variance (m, m), in their place."""
    size, own, share = len(state), variance[at, at], state * 0.0
    for j in range(size):
        share[j] = variance[at, j] / own
        state[j] += share[j] * longer
    for j in range(size):
        for k in range(size):
            variance[j, k] -= share[j] * share[k] * (1 - left) * own

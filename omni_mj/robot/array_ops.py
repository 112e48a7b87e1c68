"""Array operations that run under numpy, and under JAX while it compiles or differentiates.

Functions of this package call the functions of the module that their arguments belong to, numpy or
jax.numpy (`namespace`). States and parameters are NamedTuples of arrays. The last axis counts
robots, the axis before it wheels: a quantity per robot has the shape (n,), a quantity per wheel
(W, n). An optional field is None if no robot of the batch needs it, which saves its computation.

Sums over wheels are written term by term, because the rounding of numpy's own sums depends on the
number of robots.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

Array = Any  # of numpy or of JAX
State = TypeVar("State", bound=NamedTuple)

# Smallest radicand of `safe_sqrt`, at which the derivative of the root is finite
MIN_SQUARE = 1e-24


def namespace(array: Array) -> Any:
    """Return the module whose functions take this array: numpy or jax.numpy."""
    # The test of the type saves a method call, 0.3 us.
    return np if type(array) is np.ndarray else array.__array_namespace__()


def is_numpy(array: Array) -> bool:
    """Return whether an array is numpy's. While JAX compiles, arrays have no values to test."""
    return isinstance(array, (np.ndarray, np.generic))


def any_true(mask: Array) -> bool:
    """Return whether any element may be true: under JAX, which traces without values, always."""
    # np.count_nonzero is faster than .any() and .all() on small arrays.
    return not is_numpy(mask) or bool(np.count_nonzero(mask))


def select(condition: Array, new: State, old: State) -> State:
    """Return the `new` state for robots whose condition (n,) is true, the `old` one for others."""
    if is_numpy(condition) and np.count_nonzero(condition) == condition.size:
        return new
    xp = namespace(condition)
    return type(new)(
        *(a if a is b else xp.where(condition, a, b) for a, b in zip(new, old, strict=True))
    )


def clip(x: Array, low: Array, high: Array) -> Array:
    """Limit values to [low, high]. This is faster than numpy's own function for small arrays."""
    xp = namespace(x)
    return xp.minimum(xp.maximum(x, low), high)


def sum_wheels(x: Array) -> Array:
    """Sum over wheels, (..., W, n) -> (..., n)."""
    result = x[..., 0, :] + x[..., 1, :]
    for wheel in range(2, x.shape[-2]):
        result = result + x[..., wheel, :]
    return result


def safe_sqrt(square: Array) -> Array:
    """Return the square root, with a finite derivative at zero."""
    xp = namespace(square)
    return xp.sqrt(xp.maximum(square, MIN_SQUARE))


def rotate(vector: Array, cosine: Array, sine: Array) -> tuple[Array, Array]:
    """Rotate vectors by the angle with this cosine and sine.

    Args:
        vector: Components x and y, as an array (2, ...) or a pair of arrays.
        cosine: Cosine of the angle, counter-clockwise.
        sine: Sine of the angle.

    Returns:
        Components x and y of the rotated vectors.
    """
    x, y = vector
    return cosine * x - sine * y, sine * x + cosine * y


def cos_sin_small(angle: Array) -> tuple[Array, Array]:
    """Return cosine and sine of angles below 0.1 rad.

    Under JAX these are Taylor series with errors below 3e-13. XLA would compute a cosine again in
    each loop that uses it, which takes a third of the time of a cycle.
    """
    if is_numpy(angle):
        return np.cos(angle), np.sin(angle)
    square = angle * angle
    cosine = 1 - square * (1 / 2 - square * (1 / 24 - square * (1 / 720)))
    return cosine, angle * (1 - square * (1 / 6 - square * (1 / 120 - square * (1 / 5040))))


def solve_symmetric(a: Array, b: Array) -> Array:
    """Solve a x = b for symmetric positive definite matrices, by the factorization a = L D L'.

    Args:
        a: Matrices, (3, 3, n).
        b: Right-hand sides, (3, n).

    Returns:
        Solutions x, (3, n).
    """
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = a
    x, y, z = b
    l_yx = xy / xx
    l_zx = xz / xx
    yy = yy - l_yx * xy
    yz = yz - l_yx * xz
    l_zy = yz / yy
    y = y - l_yx * x
    z = (z - l_zx * x - l_zy * y) / (zz - l_zx * xz - l_zy * yz)
    y = y / yy - l_zy * z
    return namespace(x).stack([x / xx - l_yx * y - l_zx * z, y, z])


def straight_through_floor(x: Array) -> Array:
    """Round down, with the derivative 1 in place of the true 0 (straight-through estimator).

    With a zero derivative no gradient would pass through the encoders.
    """
    if is_numpy(x):
        return np.floor(x)
    from jax import lax

    return x + lax.stop_gradient(namespace(x).floor(x) - x)


def scan(
    step: Callable[[Any], tuple[Any, Any]], state: Any, n_steps: int, like: Array
) -> tuple[Any, Any]:
    """Apply a step a fixed number of times and stack its records.

    Args:
        step: Function that maps a state to the next state and the record of the step.
        state: NamedTuple of arrays.
        n_steps: Number of steps.
        like: An array of the same namespace.

    Returns:
        The final state, and the records with a leading axis of steps.
    """
    if not is_numpy(like):
        from jax import lax

        state, records = lax.scan(lambda state, _: step(state), state, None, n_steps)
        return state, records
    records = []
    for _ in range(n_steps):
        state, record = step(state)
        records.append(record)
    return state, stack_records(records)


def iterate_while(
    step: Callable[[Any], Any], state: Any, is_unfinished: Callable[[Any], Array], max_steps: int
) -> Any:
    """Apply a step while any robot's state is unfinished, but at most `max_steps` times."""
    if not max_steps:
        return state

    def step_and_repeat(state: Any) -> Any:
        return iterate_while(step, step(state), is_unfinished, max_steps - 1)

    unfinished = is_unfinished(state)
    if is_numpy(unfinished):
        return step_and_repeat(state) if np.count_nonzero(unfinished) else state
    from jax import lax

    return lax.cond(unfinished.any(), step_and_repeat, lambda state: state, state)


def stack_records(records: list[Any]) -> Any:
    """Stack records, which are NamedTuples of arrays, along a new first axis."""
    return type(records[0])(*map(np.array, zip(*records, strict=True)))

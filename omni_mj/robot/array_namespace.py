"""Array operations that run under numpy as they are, and under JAX while it compiles or differentiates.

Functions of this package take the namespace from the arrays that they are given (`namespace`). States and parameters
are NamedTuples of arrays. The last axis counts robots, the axis before it wheels: a quantity of robots has the shape
(n,), of their wheels (W, n). A field is None if no robot has what it describes.

Sums over wheels are written term by term, because numpy's own sums round differently for different numbers of robots.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

Array = Any  # of numpy or of JAX
Tree = TypeVar("Tree")

LEAST_SQUARE = 1e-24  # under a square root, so that its derivative stays finite at zero


def namespace(array: Array) -> Any:
    """Return the module whose functions take this array: numpy or jax.numpy."""
    # That call costs 0.3 us
    return np if type(array) is np.ndarray else array.__array_namespace__()


def is_numpy(array: Array) -> bool:
    """Return whether an array is numpy's, whose values are known."""
    return isinstance(array, (np.ndarray, np.generic))


def any_true(mask: Array) -> bool:
    """Return whether a branch must be computed. JAX does not know values, so the answer is yes."""
    return not is_numpy(mask) or bool(np.count_nonzero(mask))


def tree_map(function: Callable[..., Any], tree: Any, *others: Any) -> Any:
    """Apply a function to the arrays of nested tuples; None stays None."""
    if isinstance(tree, tuple):
        parts = [tree_map(function, *each) for each in zip(tree, *others, strict=True)]
        return type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
    return None if tree is None else function(tree, *others)


def select(condition: Array, new: Tree, old: Tree) -> Tree:
    """Return the `new` state of robots for which a condition (n,) holds, and the `old` state of the others."""
    if is_numpy(condition) and np.count_nonzero(condition) == condition.size:
        return new
    xp = namespace(condition)
    result: Tree = tree_map(lambda one, other: xp.where(condition, one, other), new, old)
    return result


def clip(x: Array, low: Array, high: Array) -> Array:
    """Limit values. This is faster than numpy's own function for small arrays."""
    xp = namespace(x)
    return xp.minimum(xp.maximum(x, low), high)


def total(x: Array) -> Array:
    """Sum over wheels, (..., W, n) -> (..., n)."""
    result = x[..., 0, :] + x[..., 1, :]
    for wheel in range(2, x.shape[-2]):
        result = result + x[..., wheel, :]
    return result


def root(square: Array) -> Array:
    """Square root with a finite derivative at zero."""
    xp = namespace(square)
    return xp.sqrt(xp.maximum(square, LEAST_SQUARE))


def rotate(x: Array, y: Array, cosine: Array, sine: Array) -> tuple[Array, Array]:
    """Rotate vectors by the angle with this cosine and sine."""
    return cosine * x - sine * y, sine * x + cosine * y


def small_rotation(angle: Array) -> tuple[Array, Array]:
    """Return cosine and sine of angles below 0.1 rad.

    XLA computes a cosine again in each loop that uses it: a third of the time of a cycle. JAX gets
    series, which are right to 3e-13.
    """
    if is_numpy(angle):
        return np.cos(angle), np.sin(angle)
    square = angle * angle
    cosine = 1 - square * (1 / 2 - square * (1 / 24 - square * (1 / 720)))
    return cosine, angle * (1 - square * (1 / 6 - square * (1 / 120 - square * (1 / 5040))))


def floor(x: Array) -> Array:
    """Round down. The derivative is that of the argument, or encoders would hide the wheels from gradients."""
    if is_numpy(x):
        return np.floor(x)
    from jax import lax

    return x + lax.stop_gradient(namespace(x).floor(x) - x)


def repeat(
    step: Callable[[Any], tuple[Any, Any]], state: Any, times: int, like: Array
) -> tuple[Any, Any]:
    """Take a step a number of times.

    Args:
        step: State -> next state, and a record of what happened.
        state: NamedTuple of arrays.
        times: Number of steps.
        like: An array of the same namespace.

    Returns:
        The last state, and the records with a leading axis of steps.
    """
    if not is_numpy(like):
        from jax import lax

        state, records = lax.scan(lambda state, _: step(state), state, None, times)
        return state, records
    steps = []
    for _ in range(times):
        state, record = step(state)
        steps.append(record)
    return state, stack_records(steps)


def refine(
    step: Callable[[Any], Any], state: Any, is_unfinished: Callable[[Any], Array], times: int
) -> Any:
    """Take a step as long as a state is unfinished anywhere, but at most a number of times."""
    if not times:
        return state

    def go_on(state: Any) -> Any:
        return refine(step, step(state), is_unfinished, times - 1)

    unfinished = is_unfinished(state)
    if is_numpy(unfinished):
        return go_on(state) if np.count_nonzero(unfinished) else state
    from jax import lax

    return lax.cond(unfinished.any(), go_on, lambda state: state, state)


def stack_records(records: list[Any]) -> Any:
    """Put records of equal structure side by side along a new first axis."""
    return tree_map(lambda *values: np.array(values), records[0], *records[1:])

"""What `laws` are compiled to, where numpy's own would keep a processor from taking several robots at once."""

from typing import Any

import numpy as np

from omni_mj.onboard import laws

# Half pi in two parts, of which the first has so many zeros at its end that its multiples are exact.
HALF_PI, REST = 1.57079632673412561417, 6.07710050650619224932e-11


def where(condition: Any, one: Any, other: Any) -> Any:
    """`laws.where` of single numbers, of which numba's np.where makes arrays."""
    return one if condition else other


def count(number: int) -> int:
    """`laws.count`, by which numba knows that an index is not from the end."""
    return np.uint64(number)  # type: ignore[return-value]


def direction(angle: Any) -> Any:
    """`laws.direction` without a call: the series of both about the nearest multiple of half pi.

    Coefficients are those of fdlibm (k_cos.c, k_sin.c), which is exact but for 1e-16; good to angles of 1e5 rad.
    """
    quarters = np.floor(angle * (2 / np.pi) + 0.5)
    x = (angle - quarters * HALF_PI) - quarters * REST
    z = x * x
    cosine = 1 - z * 0.5 + z * z * (
        4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * (
            -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))))
    )  # fmt: skip
    sine = x + x * z * (
        -1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * (
            2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))))
    )  # fmt: skip
    quarter = quarters - 4 * np.floor(quarters * 0.25)
    odd = (quarter == 1) | (quarter == 3)
    one, other = laws.where(odd, sine, cosine), laws.where(odd, cosine, sine)
    back, down = (quarter == 1) | (quarter == 2), quarter >= 2
    return laws.where(back, -one, one), laws.where(down, -other, other)

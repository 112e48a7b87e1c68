"""`make bench`: speed of the fuzzy controller over that of scikit-fuzzy with the same rules."""

import time
import warnings
from collections.abc import Callable

import numpy as np
import scikit_flc

from omni_control.fuzzy_rules import FuzzyLaw

ROUNDS = 30  # the fastest of these counts: other work on the machine only ever adds time
MANY, SOME = 10_000, 200


def main() -> None:
    """Time both in turn, so that they meet the same machine, and print the ratios."""
    warnings.simplefilter(
        "ignore", DeprecationWarning
    )  # scikit-fuzzy 0.5 calls numpy as numpy no longer likes it
    controller = FuzzyLaw(0.1, 1.0)
    single, array = (scikit_flc.controller(201, 0.1, 1.0) for _ in range(2))
    errors = np.random.default_rng(0).uniform(-0.11, 0.11, (MANY, 2))
    fresh = iter(errors)  # scikit-fuzzy remembers what it has computed

    def scikit_one() -> None:
        single.inputs(dict(zip(("e_x", "e_y"), next(fresh), strict=True)))
        single.compute()

    work: list[tuple[Callable[[], object], int]] = [
        (scikit_one, 1),
        (lambda: scikit_flc.velocities(array, errors[:SOME]), SOME),
        (lambda: [controller(error) for error in errors[:SOME]], SOME),
        (lambda: controller(errors), MANY),
    ]
    best = [np.inf] * len(work)
    for _ in range(ROUNDS):
        for i, (call, evaluations) in enumerate(work):
            start = time.process_time()
            call()
            best[i] = min(best[i], (time.process_time() - start) / evaluations)
    scikit, scikit_array, one, many = best
    apart = np.abs(controller(errors[:SOME]) - scikit_flc.velocities(array, errors[:SOME])).max()
    print("time of scikit-fuzzy over that of the fuzzy controller, universes of 201 points")
    print(f"one evaluation                         {scikit / one:8.0f}")
    print(f"one over each of {MANY} in an array    {scikit / many:8.0f}")
    print(f"each in an array over the same         {scikit_array / many:8.0f}")
    print(
        f"outputs differ by at most {apart:.0e} m/s; times: {1e3 * scikit:.1f} ms, "
        f"{1e6 * one:.1f} us, {1e6 * many:.2f} us"
    )


if __name__ == "__main__":
    main()

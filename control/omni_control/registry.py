"""The controllers' names; where each is, to be loaded when it is asked for: a list of them needs none of them.

What one needs beside numpy and scipy may be missing: `available` are those that can be made here.
"""

from importlib.util import find_spec

CONTROLLERS: dict[str, str] = {
    "flc": "omni_control.controllers.flc:Flc",
    "comp-flc": "omni_control.controllers.flc:CompFlc",
    "comp-flc-lag": "omni_control.controllers.flc:CompFlcLag",
    "inverse-flc": "omni_control.controllers.adaptive:InverseFlc",
    "adaptive-comp-flc": "omni_control.controllers.adaptive:AdaptiveCompFlc",
    "p": "omni_control.controllers.baselines:Proportional",
    "smith": "omni_control.controllers.baselines:Smith",
    "lqr": "omni_control.controllers.baselines:Lqr",
    "mpc": "omni_control.controllers.mpc:Mpc",
    "oracle": "omni_control.controllers.adaptive:Oracle",
}

NEEDS = {
    "mpc": "piqp"
}  # packages that controllers need, which the extra of the controller's name brings


def missing(name: str) -> str | None:
    """The package that the controller called `name` needs and that is not installed; None if there is none."""
    package = NEEDS.get(name)
    return package if package and find_spec(package) is None else None


def available() -> tuple[str, ...]:
    """The names of the controllers that can be made here, in the order of `CONTROLLERS`."""
    return tuple(name for name in CONTROLLERS if missing(name) is None)

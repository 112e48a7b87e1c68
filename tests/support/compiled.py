"""Loops that numba compiles, for tests of what is not reckoned between physics steps: frames take less time.

That they reckon what numpy does is the law of test_kernels.py.
"""

import fcntl
import os
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import omni_mj as om
from omni_mj.scenarios.settings import Settings

NUMBA = {"kernel": "numba"}


@cache
def once(plant: str) -> None:
    """Have a plant's loops, and a controller's, compiled by one process for all, in a minute; the others wait.

    For a robot by itself, and for several: these are other loops, or other machine code. A team's, which it has on any
    plant, come first, and with a lock of their own: two processes may need them at the same time for two plants.
    """
    if plant != "kinematic":
        once("kinematic")
    with (Path(tempfile.gettempdir()) / f"omni-mj-{os.getuid()}-{plant}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for controllers in (["adaptive-comp-flc"], ["p", "flc"]):
            om.Simulation(om.scenario("rect", plant=plant, physics=NUMBA), controllers).step()


def ready(plant: str, settings: Iterable[Settings]) -> None:
    """As above, if any of the settings asks for compiled loops."""
    if any(each.physics.kernel == "numba" for each in settings):
        once(plant)

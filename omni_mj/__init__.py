"""A MuJoCo testbed for the motion control of RoboCup Small Size League robots.

For instance::

    import omni_mj as om

    rect = om.load_scenario("rect", plant="kinematic")
    result = om.run(rect, ["flc", "comp-flc"], seeds=range(5))
    print(result.table())
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from omni_control.controllers.base import Controller, Observation
    from omni_control.errors import OmniError
    from omni_mj.config.scenario import Scenario, load_scenario
    from omni_mj.results.result import Result
    from omni_mj.results.verify import verify
    from omni_mj.simulation.simulation import Simulation
    from omni_mj.studies.alpha import measure_alpha
    from omni_mj.studies.compare import compare
    from omni_mj.studies.identify import identify
    from omni_mj.studies.limit import find_limit
    from omni_mj.studies.robot_facts import load_robot
    from omni_mj.studies.run_scenario import run
    from omni_mj.studies.slip import measure_slip
    from omni_mj.studies.sweep import sweep

    __version__: str

# Where each name is; imported when it is asked for, so that `omni-mj --help` waits for no physics.
_HOMES = {
    "Controller": "omni_control.controllers.base",
    "OmniError": "omni_control.errors",
    "Result": "omni_mj.results.result",
    "Scenario": "omni_mj.config.scenario",
    "Observation": "omni_control.controllers.base",
    "Simulation": "omni_mj.simulation.simulation",
    "measure_alpha": "omni_mj.studies.alpha",
    "compare": "omni_mj.studies.compare",
    "identify": "omni_mj.studies.identify",
    "find_limit": "omni_mj.studies.limit",
    "load_robot": "omni_mj.studies.robot_facts",
    "run": "omni_mj.studies.run_scenario",
    "load_scenario": "omni_mj.config.scenario",
    "measure_slip": "omni_mj.studies.slip",
    "sweep": "omni_mj.studies.sweep",
    "verify": "omni_mj.results.verify",
}
__all__ = [
    "Controller",
    "Observation",
    "OmniError",
    "Result",
    "Scenario",
    "Simulation",
    "__version__",
    "compare",
    "find_limit",
    "identify",
    "load_robot",
    "load_scenario",
    "measure_alpha",
    "measure_slip",
    "run",
    "sweep",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("omni-mj")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found = getattr(import_module(_HOMES[name]), name)
    return found


def __dir__() -> list[str]:
    return list(__all__)


class _Package(ModuleType):
    """The package, in which a module or folder of the name of a public function does not take its place."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

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

TYPE_CHECKING = False  # as in typing, which takes a while to import
if TYPE_CHECKING:
    from omni_control.controllers.base import Controller, Observation
    from omni_control.errors import OmniError
    from omni_mj.config.scenario import Scenario, load_scenario
    from omni_mj.embed.add_robot import add_robot
    from omni_mj.results.result import Result
    from omni_mj.robot.robot_facts import load_robot
    from omni_mj.simulation.simulation import Simulation
    from omni_mj.studies.alpha.alpha_study import measure_alpha
    from omni_mj.studies.compare_study import compare
    from omni_mj.studies.identify.identify_study import identify
    from omni_mj.studies.limit.limit_study import find_limit
    from omni_mj.studies.run_scenario import run
    from omni_mj.studies.slip.slip_study import measure_slip
    from omni_mj.studies.sweep.sweep_study import sweep
    from omni_mj.studies.verify_run import verify

    __version__: str

# Module of each public name. It is imported on first access, which keeps `omni-mj --help` fast.
_MODULES = {
    "Controller": "omni_control.controllers.base",
    "Observation": "omni_control.controllers.base",
    "OmniError": "omni_control.errors",
    "Result": "omni_mj.results.result",
    "Scenario": "omni_mj.config.scenario",
    "Simulation": "omni_mj.simulation.simulation",
    "add_robot": "omni_mj.embed.add_robot",
    "compare": "omni_mj.studies.compare_study",
    "find_limit": "omni_mj.studies.limit.limit_study",
    "identify": "omni_mj.studies.identify.identify_study",
    "load_robot": "omni_mj.robot.robot_facts",
    "load_scenario": "omni_mj.config.scenario",
    "measure_alpha": "omni_mj.studies.alpha.alpha_study",
    "measure_slip": "omni_mj.studies.slip.slip_study",
    "run": "omni_mj.studies.run_scenario",
    "sweep": "omni_mj.studies.sweep.sweep_study",
    "verify": "omni_mj.studies.verify_run",
}
__all__ = [
    "Controller",
    "Observation",
    "OmniError",
    "Result",
    "Scenario",
    "Simulation",
    "__version__",
    "add_robot",
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


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("omni-mj")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return list(__all__)


class _Package(ModuleType):
    """This package. A submodule, such as `omni_mj.run`, does not hide a public function."""

    def __setattr__(self, name: str, value: object) -> None:
        hides_function = name in _MODULES and isinstance(value, ModuleType)
        if not hides_function:
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

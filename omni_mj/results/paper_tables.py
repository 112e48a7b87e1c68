"""The paper's own results, tables 3 and 4: absolute position errors in metres."""

from functools import lru_cache

from omni_mj.config.scenario import Scenario, load_with_overrides

Table = dict[str, dict[str, dict[str, float]]]  # controller -> axis -> statistic

TABLES: dict[int, Table] = {
    3: {
        "flc": {"x": {"max": 0.03286, "mean": 0.0036}, "y": {"max": 0.07611, "mean": 0.0133}},
        "comp-flc": {"x": {"max": 0.02124, "mean": 0.00055}, "y": {"max": 0.03864, "mean": 0.0057}},
    },
    4: {
        "flc": {"x": {"max": 0.04557, "mean": 0.0113}, "y": {"max": 0.10154, "mean": 0.0175}},
        "comp-flc": {"x": {"max": 0.03007, "mean": 0.0074}, "y": {"max": 0.04111, "mean": 0.0010}},
    },
}
SCENARIOS = {3: "rect", 4: "rect-noise"}
# What the robot shall do and what it meets; what its firmware and the team make of it may be tried.
DEFINING = ("reference", "world", "disturbance", "radio", "fault")
ON_WHEELS = ("carpet", "drivetrain", "motor", "battery", "body", "wheels")
PLANT_PARTS = {"kinematic": ("kinematic",), "mujoco": ON_WHEELS, "planar": ON_WHEELS}


def find_paper_table(scenario: Scenario) -> Table | None:
    """The paper's table that reports what `scenario` runs; None where that is not the paper's experiment."""
    if scenario.paper_table not in TABLES or scenario.plant == "live":
        return None
    own = _experiment(scenario.paper_table, scenario.robot)
    parts = (*DEFINING, *PLANT_PARTS.get(scenario.plant, ()))
    same = all(getattr(scenario.settings, name) == getattr(own.settings, name) for name in parts)
    return TABLES[scenario.paper_table] if same else None


@lru_cache
def _experiment(number: int, robot: str) -> Scenario:
    return load_with_overrides(SCENARIOS[number], head={"robot": robot})

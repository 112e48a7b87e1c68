"""Position errors that the paper reports in tables 3 and 4, and the scenarios they belong to."""

from omni_mj.config.scenario import Scenario, load_with_overrides

PaperTable = dict[str, dict[str, dict[str, float]]]  # controller -> axis -> statistic -> m

TABLES: dict[int, PaperTable] = {
    3: {
        "flc": {"x": {"max": 0.03286, "mean": 0.0036}, "y": {"max": 0.07611, "mean": 0.0133}},
        "comp-flc": {"x": {"max": 0.02124, "mean": 0.00055}, "y": {"max": 0.03864, "mean": 0.0057}},
    },
    4: {
        "flc": {"x": {"max": 0.04557, "mean": 0.0113}, "y": {"max": 0.10154, "mean": 0.0175}},
        "comp-flc": {"x": {"max": 0.03007, "mean": 0.0074}, "y": {"max": 0.04111, "mean": 0.0010}},
    },
}
SCENARIOS = {3: "rect", 4: "rect-noise"}  # table -> scenario of its experiment
# Sections that define the experiment: the robot's task and environment. Settings of the firmware
# and the team may differ.
TASK_SECTIONS = ("reference", "world", "disturbance", "radio", "fault")
WHEEL_SECTIONS = ("carpet", "drivetrain", "motor", "battery", "body", "wheels")
PLANT_SECTIONS = {
    "kinematic": ("kinematic",),
    "mujoco": WHEEL_SECTIONS,
    "planar": WHEEL_SECTIONS,
}


def find_paper_table(scenario: Scenario) -> PaperTable | None:
    """Return the paper's errors for a scenario, or None if it is not an experiment of the paper."""
    if scenario.paper_table not in TABLES or scenario.plant == "live":
        return None
    experiment = load_with_overrides(
        SCENARIOS[scenario.paper_table], top_level={"robot": scenario.robot}
    )
    sections = (*TASK_SECTIONS, *PLANT_SECTIONS.get(scenario.plant, ()))
    is_same = all(
        getattr(scenario.settings, name) == getattr(experiment.settings, name) for name in sections
    )
    return TABLES[scenario.paper_table] if is_same else None

"""The trackers by the names that users call them."""

from omni_control.adaptive import AdaptiveFuzzyTracker
from omni_control.lqr import LqrTracker
from omni_control.oracle import OracleTracker
from omni_control.rivals import ProportionalTracker, SmithTracker
from omni_control.tracker import CompensatedFuzzyTracker, FuzzyTracker, Tracker

TRACKERS: dict[str, type[Tracker]] = {
    "flc": FuzzyTracker,
    "comp-flc": CompensatedFuzzyTracker,
    "adaptive-comp-flc": AdaptiveFuzzyTracker,
    "p": ProportionalTracker,
    "smith": SmithTracker,
    "lqr": LqrTracker,
    "oracle": OracleTracker,
}

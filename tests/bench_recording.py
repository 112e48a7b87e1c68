"""Measure the cost of a recorded frame late in a run, compared with early in it."""

import sys
import tempfile
import time
from pathlib import Path

from omni_mj.config import scenario
from omni_mj.simulation.simulation import Simulation
from omni_mj.viz.recording import Recording

LAPS, QUARTERS, LIMIT = 40, 4, 1.5


def main() -> int:
    """Print the cost of a frame in each quarter of a run.

    Returns:
        1 if the last quarter costs more than `LIMIT` times the second, else 0.
    """
    simulation = Simulation(
        scenario.load_with_overrides("rect", [f"reference.laps={LAPS}"], {"plant": "kinematic"}),
        ["flc"],
    )
    frames = max(reference.frames for reference in simulation.references)
    cost_s = [0.0] * QUARTERS
    with (
        tempfile.TemporaryDirectory() as folder,
        Recording(Path(folder) / "long.rrd", simulation) as recording,
    ):

        def after_frame(frame: int) -> None:
            start = time.process_time()
            recording.update()
            cost_s[QUARTERS * frame // frames] += time.process_time() - start

        simulation.run(after_frame)
    costs = ", ".join(f"{1e6 * QUARTERS * cost / frames:.0f}" for cost in cost_s)
    ratio = cost_s[-1] / cost_s[1]  # the first quarter includes the start of rerun
    print(f"{frames} frames: {costs} us per frame in the quarters, last/second {ratio:.2f}")
    return int(ratio > LIMIT)


if __name__ == "__main__":
    sys.exit(main())

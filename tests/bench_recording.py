"""What a frame of a recording costs late in a run, against early in it, as `make bench` runs it."""

import sys
import tempfile
import time
from pathlib import Path

from omni_mj.config import scenario
from omni_mj.simulation.simulation import Simulation
from omni_mj.viz.recording import Recording

LAPS, PARTS, LIMIT = 40, 4, 1.5


def main() -> int:
    """Print the cost of a frame in each quarter of a run; 1 if the last costs `LIMIT` times what the second does."""
    simulation = Simulation(
        scenario.load_with_overrides("rect", [f"reference.laps={LAPS}"], {"plant": "kinematic"}),
        ["flc"],
    )
    frames, spent = max(reference.frames for reference in simulation.references), [0.0] * PARTS
    with (
        tempfile.TemporaryDirectory() as folder,
        Recording(Path(folder) / "long.rrd", simulation) as recording,
    ):

        def after_frame(frame: int) -> None:
            began = time.process_time()
            recording.update()
            spent[PARTS * frame // frames] += time.process_time() - began

        simulation.run(after_frame)
    each = ", ".join(f"{1e6 * PARTS * part / frames:.0f}" for part in spent)
    print(f"a recording of {frames} frames: {each} us a frame in its quarters", end=", ")
    print(
        f"{spent[-1] / spent[1]:.2f} times as much in the last as in the second"
    )  # the first starts the viewer's code
    return int(spent[-1] > LIMIT * spent[1])


if __name__ == "__main__":
    sys.exit(main())

"""Measure CPU time and memory of sweeps over `rect`, and extrapolate to a million runs.

Each sweep is a process of its own. The dead time has ten values.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

SWEEP = "-m omni_mj sweep --quiet --scenario rect --controller comp-flc"
SHORT = "--set reference.waypoints=[[0,0],[0.2,0.1]] --set reference.settle_s=0.2"
POINTS = 10
CASES = {"--plant planar": 500, f"--plant kinematic {SHORT}": 10_000}  # options -> runs


def measure_sweep(options: str, runs: int) -> tuple[float, float, float]:
    """Return CPU time in s, peak memory in GB, and bytes per run of the table of a sweep."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "sweep"
        vary = f"--vary radio.delay_frames=0:{POINTS - 1}:{POINTS} --seeds {runs // POINTS}"
        words = f"{SWEEP} {options} {vary} --out {out}".split()
        _, status, used = os.wait4(subprocess.Popen([sys.executable, *words]).pid, 0)
        assert status == 0, "the sweep failed"
        size = (out / "rows.parquet").stat().st_size / runs
        return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6, size


def main() -> None:
    """Measure and print."""
    print("  runs    CPU-s  highest GB  bytes a run  CPU-hours of a million  options")
    for options, runs in CASES.items():
        cpu, memory, size = measure_sweep(options, runs)
        hours = cpu / runs * 1e6 / 3600
        row = f"{runs:6d} {cpu:8.1f} {memory:11.2f} {size:12.0f} {hours:23.1f}"
        print(row, options, flush=True)


if __name__ == "__main__":
    main()

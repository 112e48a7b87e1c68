"""Machine faults, a few of those of `make soak`, at other moments each time."""

import subprocess
import sys
from pathlib import Path

SOAK = Path(__file__).parents[1] / "soak"


def test_a_few_machine_faults() -> None:
    """Kills, signals, disks that are full, memory that is short; what goes wrong is printed, with the seed."""
    done = subprocess.run(
        [sys.executable, str(SOAK), "kills=1", "signals=3", "sizes=2"], capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stdout + done.stderr

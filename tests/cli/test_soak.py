"""Machine faults, a few of those of `make soak`, at other moments each time."""

import subprocess
import sys
from pathlib import Path

SOAK = Path(__file__).parents[1] / "soak"


def test_a_few_machine_faults() -> None:
    """A kill, signals, a disk that is full; what goes wrong is printed, with the seed."""
    done = subprocess.run(
        [sys.executable, str(SOAK), "kills=1", "signals=2", "disks=1"], capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stdout + done.stderr

"""Free memory of the computer."""

import math
from pathlib import Path

from omni_control.errors import OmniError

MEMORY_FRACTION = 0.25  # of the free memory, for a table; its readers make copies


def measure_free_bytes() -> float:
    """Return how many bytes of memory are free; infinity on systems without `/proc/meminfo`."""
    try:
        text = Path("/proc/meminfo").read_text()
        return 1024.0 * int(text.split("MemAvailable:")[1].split()[0])
    except (OSError, IndexError):
        return math.inf


def require_memory(path: Path, content: str, n_bytes: float) -> None:
    """Raise `OmniError` if some content of a file needs too much memory."""
    if n_bytes > (max_bytes := MEMORY_FRACTION * measure_free_bytes()):
        raise OmniError(
            f"{path} cannot be read: {content} need {n_bytes / 1e9:.2g} GB of memory; at most "
            f"{max_bytes / 1e9:.2g} GB, {MEMORY_FRACTION:.0%} of the free memory, are allowed"
        )

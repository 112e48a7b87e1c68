"""Compile a user's MJCF in another process, with limits of memory and time.

A few lines of MJCF or a small image can expand to any size, and MuJoCo cannot be interrupted.
"""

import os
import subprocess
import sys
from pathlib import Path

from omni_control.errors import OmniError

MAX_MEMORY_GB = 0.5
MAX_CPU_S = 10
_PROGRAM = f"""
import resource
import sys
import warnings
for limit, value in (("DATA", {MAX_MEMORY_GB * 1e9:.0f}), ("CPU", {MAX_CPU_S}), ("CORE", 0)):
    resource.setrlimit(getattr(resource, "RLIMIT_" + limit), (value, value))
sys.path[:] = sys.argv[2:]
import mujoco
messages = []
warnings.filterwarnings("error", "Inertia matrix")
mujoco.set_mju_user_warning(
    # Attached models may have other options, which have no effect.
    lambda text: text.startswith("Attach conflict") or messages.append(text)
)
try:
    spec = mujoco.MjSpec.from_file(sys.argv[1])
    spec.compiler.usethread = False
    spec.compile()
except (ValueError, UserWarning) as error:
    if "allocat" in str(error):
        raise
    messages = [str(error)]
for message in messages[:1]:
    print(" ".join(message.split()))
"""


def check_compiles(path: Path) -> None:
    """Compile a model with little memory and time.

    Raises:
        OmniError: MuJoCo warns of it or refuses it, needs more memory or time, or crashes.
    """
    process = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(path), *sys.path],
        env={**os.environ, "MUJOCO_GL": "disable", "OPENBLAS_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
    )
    if process.returncode:
        raise OmniError(
            f"MuJoCo cannot compile it with {MAX_MEMORY_GB:g} GB of memory in {MAX_CPU_S} s; use "
            "fewer elements, smaller images and meshes with fewer faces"
        )
    if process.stdout:
        raise OmniError(process.stdout.strip())

"""Compile a user's MJCF in another process, with limits of memory and time.

A few lines of MJCF or a small image can expand to any size, and MuJoCo cannot be interrupted.
"""

import subprocess
import sys
from pathlib import Path

import mujoco

from omni_control.errors import OmniError

MAX_MEMORY_GB = 0.5
MAX_CPU_S = 10
# Calls MuJoCo's C library, because the import of its Python package takes longer than most models.
_PROGRAM = f"""
import ctypes, os, resource, sys
for limit, value in (("DATA", {MAX_MEMORY_GB * 1e9:.0f}), ("CPU", {MAX_CPU_S}), ("CORE", 0)):
    resource.setrlimit(getattr(resource, "RLIMIT_" + limit), (value, value))
if hasattr(os, "sched_setaffinity"):  # MuJoCo starts a thread per core, each with a stack
    os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
model, library, plugins = map(os.fsencode, sys.argv[1:])
mujoco = ctypes.CDLL(os.fsdecode(library))
mujoco.mj_loadAllPluginLibraries(plugins, None)
messages = []
add_message = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(messages.append)
handler = ctypes.c_void_p.in_dll(mujoco, "mju_user_warning")
handler.value = ctypes.cast(add_message, ctypes.c_void_p).value
mujoco.mj_parseXML.restype = mujoco.mj_compile.restype = ctypes.c_void_p
mujoco.mjs_getError.restype = mujoco.mjs_getWarning.restype = ctypes.c_char_p
buffer = ctypes.create_string_buffer(2000)
spec = ctypes.c_void_p(mujoco.mj_parseXML(model, None, buffer, len(buffer)))
if not spec or not mujoco.mj_compile(spec, None):
    messages = [mujoco.mjs_getError(spec) if spec else buffer.value]
    if b"allocat" in messages[0]:
        sys.exit(1)
else:
    warnings = [mujoco.mjs_getWarning(spec, i) for i in range(mujoco.mjs_numWarnings(spec))]
    # Old features of MJCF are allowed, but no inconsistent inertias. Attached models may have other
    # options, without effect.
    allowed = [text for text in messages if text.startswith(b"Attach conflict")] + warnings
    messages = [text for text in messages if text not in allowed]
    messages += [text for text in warnings if text.startswith(b"Inertia matrix")]
for message in messages[:1]:
    print(" ".join(message.decode(errors="replace").split()))
"""


def check_compiles(path: Path) -> None:
    """Compile a model with little memory and time.

    Raises:
        OmniError: MuJoCo warns of it or refuses it, needs more memory or time, or crashes.
    """
    folder = Path(mujoco.__file__).parent
    library = next(folder.glob("libmujoco*"))
    process = subprocess.run(
        [sys.executable, "-I", "-S", "-c", _PROGRAM, path, library, folder / "plugin"],
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

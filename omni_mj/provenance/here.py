"""What is here that a result depends on, beside what is run: versions, the package's own source, the machine.

No names of users, hosts or folders are in it.
"""

import hashlib
import os
import platform
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import omni_control
from omni_mj.measure.summary import installed, versions
from omni_mj.scenarios import models

SOURCE = (".py", ".toml", ".xml")  # suffixes of what a result can depend on
GIT_S = 5.0  # that git may take, s
_PACKAGE = Path(__file__).parents[1]


def environment() -> dict[str, Any]:
    """Versions, hashes of the package's source, its commit where it is a checkout, the machine."""
    return {"versions": versions(), "source": source(), "git": git(), "machine": machine()}


def differences(recorded: Mapping[str, Any]) -> list[str]:
    """In what this is not the environment that was recorded, a line each."""
    here, lines = environment(), []
    for part in ("versions", "source", "machine"):
        ours, theirs = here[part], recorded.get(part) or {}
        if part == "versions":  # what a user's files import is recorded too
            ours |= installed(theirs.keys() - ours.keys())
        for name in (name for name in dict.fromkeys([*theirs, *ours]) if ours.get(name) != theirs.get(name)):
            before, now = theirs.get(name) or "not recorded", ours.get(name) or "not there"
            source = f"the source of {name} is another than in the run"
            lines.append(source if part == "source" else f"{name} was {before} in the run, is {now} here")
    ours, theirs = (_commit(each) for each in (here["git"], recorded.get("git")))
    return [*lines, f"the run was of {theirs}, here is {ours}"] if ours != theirs else lines


def digest(data: bytes) -> str:
    """Its SHA-256, in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def source() -> dict[str, str]:
    """A hash over names and contents of the files of each package, and of the models."""
    folders = {"omni_mj": _PACKAGE, "omni_control": Path(omni_control.__file__).parent, "models": models.folder()}
    return {name: _hash(folder) for name, folder in folders.items()}


def git() -> dict[str, Any] | None:
    """The commit of the checkout that this package is in, and whether files in it were changed since; None in no such.

    Of files, those count that are part of the source: of the packages and models.
    """
    root = _PACKAGE.parent
    if not (root / ".git").exists():
        return None
    # A git that calls us, as for a hook, tells its own about another checkout by such variables.
    plain = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}

    def ask(*words: str) -> str:
        command = ["git", "--no-optional-locks", "-C", str(root), *words]
        done = subprocess.run(command, env=plain, capture_output=True, text=True, timeout=GIT_S, check=True)
        return done.stdout.strip()

    try:
        commit, changed = ask("rev-parse", "HEAD"), ask("status", "--porcelain", "--", "omni_mj", "control", "models")
    except (OSError, subprocess.SubprocessError):
        return None  # without git, or in a checkout of somebody else's
    return {"commit": commit, "changed": bool(changed)}


def machine() -> dict[str, str]:
    """The processor, what numpy and its BLAS use of it, and the system's mathematics: last bits may depend on them."""
    built = np.show_config(mode="dicts")
    blas = built["Build Dependencies"]["blas"]
    return {
        "CPU": _cpu(),
        "CPU features": " ".join(built["SIMD Extensions"].get("found", [])),
        "BLAS": f"{blas.get('name')} {blas.get('version')}",
        "architecture": platform.machine(),
        "system": platform.system(),
        "C library": " ".join(word for word in platform.libc_ver() if word),
    }


def _hash(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.suffix in SOURCE)
    lines = [f"{digest(path.read_bytes())} {path.relative_to(folder).as_posix()}\n" for path in files]
    return digest("".join(lines).encode())


def _cpu() -> str:
    """Return the processor's name, which Python leaves out on Linux."""
    file = Path("/proc/cpuinfo")
    text = file.read_text(encoding="utf-8", errors="replace") if file.exists() else ""
    name = re.search(r"^model name\s*: (.*)$", text, re.MULTILINE)
    return name[1] if name else platform.processor()


def _commit(found: Mapping[str, Any] | None) -> str:
    if not found:
        return "no commit that is known"
    return f"commit {found['commit'][:12]}" + ", changed since" * bool(found["changed"])

"""Commands that install the optional packages of this program."""

import json
import os
import shlex
import sys
from importlib.metadata import Distribution, PackageNotFoundError
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname


def describe_installation(extra: str) -> str:
    """Return the command that installs an extra from where this program was installed.

    That is a folder with its source, as a clone of the repository, or a package.
    """
    requirement, flag = "omni-mj", ""
    for name in ("omni-mj", "omni-control"):
        try:
            origin_text = Distribution.from_name(name).read_text("direct_url.json")
        except PackageNotFoundError:
            continue
        requirement = name
        origin = json.loads(origin_text or "{}")
        if "dir_info" in origin:  # installed from a folder; see PEP 610
            requirement = _shorten(url2pathname(urlparse(origin["url"]).path))
            flag = "-e " if origin["dir_info"].get("editable") else ""
        break
    is_virtual = sys.prefix != sys.base_prefix
    pip = _shorten(str(Path(sys.executable).with_name("pip"))) if is_virtual else "pip"
    return f"{shlex.quote(pip)} install {flag}{shlex.quote(f'{requirement}[{extra}]')}"


def _shorten(path: str) -> str:
    """Return a path relative to the current folder if it is there or below."""
    try:
        relative_path = os.path.relpath(path)
    except (OSError, ValueError):  # the current folder was deleted, or is on another drive
        return path
    return path if relative_path.startswith("..") else relative_path

"""Folders for results: made when needed, never overwritten unasked."""

import shutil
from collections.abc import Iterable
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path

from omni_control.errors import OmniError

PROVENANCE = (
    "provenance.json",
    "sources",
)  # what says what was run, of which `omni_mj.provenance.record` has the names


def prepare(out: Path | None, name: str, outputs: Iterable[str], overwrite: bool) -> Path:
    """Return a folder for results, made if need be.

    Args:
        out: the folder, or None for a new one below runs/.
        name: of what is run, for a new folder's name.
        outputs: files and folders that an earlier run may have left there, removed when overwriting.
        overwrite: whether a folder that holds anything may be used.

    Raises:
        OmniError: the folder is a file, is not empty, or cannot be made.
    """
    if out is None:
        base = Path("runs") / f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
        names = chain([base], (Path(f"{base}-{i}") for i in count(2)))  # two runs may start in the same second
        out = next(path for path in names if not path.exists())
    if out.exists() and not out.is_dir():
        raise OmniError(f"--out {out} is a file; give a folder")
    if out.is_dir() and any(out.iterdir()):
        if not overwrite:
            raise OmniError(f"--out {out} is not empty; give another folder, or --overwrite to replace the run in it")
        for output in outputs:
            if (old := out / output).is_dir():
                shutil.rmtree(old)
            else:
                old.unlink(missing_ok=True)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OmniError(f"cannot make the folder {out}: {error.strerror}; give another with --out") from None
    return out

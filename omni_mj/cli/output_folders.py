"""Folders for results: made when needed, and never overwritten unasked."""

import shutil
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from omni_control.errors import OmniError
from omni_mj.files import read_json

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario

PROVENANCE = ("provenance.json", "sources")  # names given by `omni_mj.results.provenance`


def prepare(out: Path | None, name: str, outputs: Iterable[str], overwrite: bool) -> Path:
    """Return a folder for results, made if need be.

    Args:
        out: The folder, or None for a new one below runs/.
        name: Name of what is run, for a new folder's name.
        outputs: Files and folders of an earlier run, removed when overwriting; all else stays.
        overwrite: Whether the folder of an earlier run may be used again.

    Raises:
        OmniError: The folder is not empty, no run left it, or it cannot be made.
    """
    base = f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    names = (f"{base}-{number}" if number else base for number in count())
    folder = out or next(path for name in names if not (path := Path("runs") / name).exists())
    try:
        if out and out.exists() and next(out.iterdir(), None):
            if not overwrite:
                raise OmniError(
                    f"--out {out} is not empty; give another folder, or --overwrite to replace the run in it"
                )
            _clear(out, outputs)
        folder.mkdir(parents=True, exist_ok=out is not None)
    except OSError as error:
        raise OmniError(
            f"cannot use the folder {folder}: {error.strerror}; give another with --out"
        ) from None
    return folder


def _clear(out: Path, outputs: Iterable[str]) -> None:
    """Remove what a run left in its folder.

    Raises:
        OmniError: No run left the folder.
    """
    try:
        is_run = "study" in read_json(out / PROVENANCE[0])
    except OmniError:
        is_run = False
    if not is_run:
        raise OmniError(
            f"--out {out} was not left by a run: it has no {PROVENANCE[0]} of one; --overwrite "
            "replaces runs, and nothing else; give another folder"
        )
    for path in (out / output for output in outputs):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def begin_record(
    folder: Path,
    study: str,
    command: str | None,
    scenarios: "Sequence[Scenario]",
    frames: bool = True,
) -> None:
    """Write what is about to be run, and a summary of nothing done, which a killed run leaves.

    Args and errors: see `omni_mj.results.provenance.save_provenance`.
    """
    from omni_mj.results import provenance
    from omni_mj.results.result import Outcome, Result

    provenance.save_provenance(folder, study, command, scenarios, frames)
    outcomes = [Outcome.not_run(scenario) for scenario in scenarios]
    Result(outcomes, scenarios[0].labels, seeds=scenarios[0].seed_list).save_summary(folder)

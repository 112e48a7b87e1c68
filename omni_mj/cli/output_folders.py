"""Output folders of commands: created when needed, and overwritten only on request."""

import shutil
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import click

from omni_control.errors import OmniError
from omni_mj.cli import console
from omni_mj.io.atomic_files import lock_folder, read_json

if TYPE_CHECKING:
    from omni_mj.config.scenario import Scenario

PROVENANCE = ("provenance.json", "sources")  # written by `omni_mj.results.provenance`


def prepare_folder(out: Path | None, name: str, outputs: Iterable[str], overwrite: bool) -> Path:
    """Return a folder for results, created if needed, which this command alone writes to.

    Args:
        out: The folder, or None for a new one in runs/.
        name: Beginning of a new folder's name.
        outputs: Files and folders of an earlier run that are removed if `overwrite` is set.
        overwrite: Whether the folder of an earlier run of the same command may be used again.

    Raises:
        OmniError: The folder is not empty, was not created by this command, cannot be created, or
            another program writes to it.
    """
    folder = out or Path("runs")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder = out or _create_subfolder(folder, name)
        reserve_folder(folder)
        if next(folder.iterdir(), None):
            if not overwrite:
                raise OmniError(
                    f"--out {out} is not empty; name another folder, or replace the run in it with "
                    "--overwrite"
                )
            _remove_outputs(folder, outputs)
    except OSError as error:
        raise OmniError(
            f"cannot use the folder {folder}: {error.strerror}; name another with --out"
        ) from None
    return folder


def reserve_folder(folder: Path) -> None:
    """Lock a folder until the running command ends.

    Raises:
        OmniError: Another program writes to it.
    """
    click.get_current_context().with_resource(lock_folder(folder))


def _create_subfolder(parent: Path, name: str) -> Path:
    """Create a folder whose name ends in the time, and return it."""
    base = f"{name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    for number in count():
        folder = parent / (f"{base}-{number}" if number else base)
        with suppress(FileExistsError):  # of another run in the same second
            folder.mkdir()
            return folder
    raise AssertionError  # unreachable


def write_initial_files(
    folder: Path,
    study: str,
    scenarios: "Sequence[Scenario]",
    frames: bool = True,
    subject: str | None = None,
) -> None:
    """Write provenance, scenarios and a summary without results, which remain after a kill.

    Args:
        folder: Folder of the run.
        study: Name of the command.
        scenarios: Scenarios of the run.
        frames: Whether trajectories will be saved.
        subject: Controller that the verdicts are about.
    """
    from omni_mj.results import provenance
    from omni_mj.results.result import Outcome, Result, scenario_texts

    options = provenance.describe_options(scenario_texts(scenarios), frames, subject)
    provenance.save_provenance(folder, study, console.get_command_line(), scenarios, options)
    outcomes = [Outcome.not_run(scenario) for scenario in scenarios]
    head = scenarios[0]
    Result(outcomes, head.labels, seeds=head.seed_list, subject=subject).save_files(folder)


def _remove_outputs(out: Path, outputs: Iterable[str]) -> None:
    """Remove the outputs of an earlier run from its folder.

    Raises:
        OmniError: The folder was not created by a run of the current command.
    """
    try:
        study = read_json(out / PROVENANCE[0]).get("study")
    except OmniError:
        study = None
    if study is None:
        raise OmniError(
            f"--out {out} was not created by a run: its {PROVENANCE[0]} is missing or invalid; "
            "--overwrite replaces runs only; name another folder"
        )
    if study != (command := click.get_current_context().command.name):
        raise OmniError(
            f"--out {out} holds results of omni-mj {study}, which would be mixed with those of "
            f"{command}; name another folder"
        )
    for path in (out / output for output in outputs):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)

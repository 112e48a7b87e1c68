"""Run a study that measures whole scenarios: what `omni-mj alpha`, `loop` and `slip` share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omni_mj.cli import console, folders, options
from omni_mj.scenarios.scenario import Scenario

Begin = Callable[[str, int], Callable[[int], None]]


@dataclass(frozen=True)
class StudyCommand:
    """A study as the command line runs it.

    Attributes:
        name: Name of the command.
        outputs: Files and folders that it writes.
        measure: Return the result for scenarios. `Begin` takes a title and the number of frames; its result is called
            after each frame.
        draw: Save the figure of a result in a folder.
    """

    name: str
    outputs: Sequence[str]
    measure: Callable[[Sequence[Scenario], Begin], Any]
    draw: Callable[[Any, Path], None]

    def run(self, chosen: Sequence[Scenario], out: Path | None, overwrite: bool, quiet: bool) -> None:
        """Measure scenarios, save the result, and end the program if the study was stopped or rows failed."""
        from omni_mj.cli.console import Interrupts

        for scenario in chosen:
            options.tell_model(scenario, quiet)
        folder = folders.prepare(out, self.name, self.outputs, overwrite)
        with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:
            folders.begin_record(folder, self.name, console.command_line(), chosen, frames=False)
            result = self.measure(chosen, lambda *what: console.checked(interrupts.check, begin(*what)))
        with console.writing(folder):
            result.save_files(folder)
            if result.table():
                with console.drawing(folder):
                    self.draw(result, folder)
        if not quiet:
            console.tell(result, folder, self.outputs)
        interrupts.end(result.stopped, f"what there is is in {folder}")
        console.fail_rows({outcome.scenario.name: outcome.failures for outcome in result.outcomes})

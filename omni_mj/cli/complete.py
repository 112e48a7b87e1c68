"""What a shell offers for a word that is not whole: names of what there is, and else files."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

Complete = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]


def _listed(*lists: str, files: bool = True, end: str = "") -> Complete:
    """Completes names of lists of `omni-mj list`.

    Args:
        lists: their titles.
        files: whether a file will do as well.
        end: what follows a name.
    """

    def complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> "list[CompletionItem]":
        from click.shell_completion import CompletionItem

        from omni_mj.show import listing

        rows = [(row[0] + end, row[-1]) for title in lists for row in listing.rows(title)]
        names = [CompletionItem(name, help=meaning) for name, meaning in rows if name.startswith(incomplete)]
        return [CompletionItem(incomplete, type="file")] * files + names  # shells take files if no name fits

    return complete


def files(context: click.Context, parameter: click.Parameter, incomplete: str) -> "list[CompletionItem]":
    """Completes files alone."""
    from click.shell_completion import CompletionItem

    return [CompletionItem(incomplete, type="file")]


scenarios = _listed("scenarios")
controllers = _listed("controllers")
plants = _listed("plants")
robots = _listed("robots")
settings = _listed("settings", files=False, end="=")
shown = _listed("scenarios", "robots", "controllers")

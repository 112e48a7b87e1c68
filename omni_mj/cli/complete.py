"""What a shell offers for a word that is not whole: names of what there is, and else files."""

from collections.abc import Callable, Iterable
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
        from omni_mj.show import listing

        rows = [(row[0] + end, row[-1]) for title in lists for row in listing.rows(title)]
        return offered(incomplete, rows, files)

    return complete


def offered(incomplete: str, rows: Iterable[tuple[str, str]], files: bool = False) -> "list[CompletionItem]":
    """What a shell is told of names and their meanings; shells take files, where they may, if no name fits."""
    from click.shell_completion import CompletionItem

    items = [CompletionItem(name, help=meaning) for name, meaning in rows if name.startswith(incomplete)]
    return [CompletionItem(incomplete, type="file")] * files + items


def files(context: click.Context, parameter: click.Parameter, incomplete: str) -> "list[CompletionItem]":
    """Completes files alone."""
    return offered(incomplete, [], files=True)


scenarios = _listed("scenarios")
controllers = _listed("controllers")
plants = _listed("plants")
robots = _listed("robots")
settings = _listed("settings", files=False, end="=")
shown = _listed("scenarios", "robots", "controllers")

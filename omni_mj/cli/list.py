"""`omni-mj list`: what there is to name."""

import click

from omni_control.errors import OmniError, choose
from omni_mj.show import listing


@click.command("list")
@click.argument("what", required=False, metavar=f"[{'|'.join(listing.TITLES)}]")
@click.argument("word", required=False, metavar="[WORD]")
def command(what: str | None, word: str | None) -> None:
    """List scenarios, controllers, plants, robots, settings and faults: all, one list, or what has WORD in it.

    omni-mj list settings friction prints the settings in whose name or meaning that word stands; omni-mj list friction
    looks for it in all lists.
    """
    only = next((title for title in listing.TITLES if what in (title, title[:-1])), None)
    if only is None and word is not None:
        raise OmniError(f"there is no list {what!r}; {choose(what, listing.TITLES)}")
    listing.show(only, word if only else what)

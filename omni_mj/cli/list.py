"""`omni-mj list`: what there is to name."""

import click


@click.command("list")
def command() -> None:
    """List scenarios, controllers, plants, robots and settings."""
    from omni_mj.show import listing

    listing.show()

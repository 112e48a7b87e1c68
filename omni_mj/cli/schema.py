"""`omni-mj schema`: what editors check scenario files against."""

import click


@click.command("schema")
def command() -> None:
    """Print the JSON Schema of scenario files."""
    import json

    from omni_mj.scenarios.scenario import schema

    print(json.dumps(schema(), indent=2))

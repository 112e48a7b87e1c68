"""The robots that come with the package: a file each, with every number of it and where that comes from."""

from pathlib import Path


def builtin() -> dict[str, Path]:
    """Their files, by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))}

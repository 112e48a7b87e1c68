"""The scenarios that come with the package."""

from pathlib import Path


def builtin() -> dict[str, Path]:
    """Their files, by name."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"))}

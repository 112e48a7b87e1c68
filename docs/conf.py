"""The documentation site: the pages of the repository as they stand, and references made from the code.

Built by `make docs`, which any warning fails, such as one of a link that leads nowhere.
"""

from collections.abc import Iterable
from importlib.metadata import version as installed
from itertools import groupby
from typing import Any

from omni_mj.viz import catalog

project = "omni-mj"
author = copyright = "the omni-mj authors"
release = version = installed("omni-mj")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_click"]
root_doc = "README"
include_patterns = [
    "README.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "docs/**.md",
    "control/README.md",
    "models/README.md",
]
exclude_patterns = [".*", "build", "dist", "runs", "tests", "omni_mj", "examples"]

# The pages below their headings, in the side bar; pages know nothing of the site, since they are
# read on forges too.
NAVIGATION = {
    "Begin": ["docs/install", "docs/tour", "docs/commands", "docs/python"],
    "Lessons": ["docs/lessons/dead-time", "docs/lessons/alpha-and-slip", "docs/lessons/identify"],
    "How to": [
        "docs/scenarios",
        "docs/reference",
        "docs/faults",
        "docs/scale",
        "docs/gym",
        "docs/robust",
        "docs/robots",
        "docs/identify",
        "docs/live",
        "docs/outputs",
        "docs/repeat",
        "control/README",
    ],
    "How it drives": ["docs/results", "docs/controllers", "docs/limit", "docs/loop", "docs/paper"],
    "How it is made": [
        "docs/physics",
        "docs/slip",
        "docs/planar",
        "docs/performance",
        "models/README",
        "docs/architecture",
        "CONTRIBUTING",
    ],
    "Reference": ["docs/api", "docs/command-line", "docs/settings", "CHANGELOG"],
}

myst_heading_anchors = 4
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
smartquotes = False
html_theme = "furo"
html_title = f"omni-mj {release}"
html_additional_pages = {"index": "to_readme.html"}
html_show_sourcelink = False
templates_path = ["site"]


def navigation() -> str:
    """The tables of contents that the side bar shows."""
    return "".join(
        f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n"
        + "\n".join(f"/{page}" for page in pages)
        + "\n```\n"
        for heading, pages in NAVIGATION.items()
    )


def settings() -> str:
    """The lists of settings and faults as tables, the settings by section."""
    sections = groupby(catalog.rows("settings"), lambda line: line[0].partition(".")[0])
    tables = [f"\n## [{section}]\n\n" + _table(lines) for section, lines in sections]
    return "".join(tables) + "\n## Faults: [[fault]]\n\n" + _table(catalog.faults())


def _table(lines: Iterable[list[str]]) -> str:
    """Lines of a list as a table; the default and its unit in one column, for want of room."""
    rows = [
        [f"`{name.rpartition('.')[2].strip()}`", f"{default} {unit}".strip(), allowed, meaning]
        for name, default, unit, allowed, meaning in lines
    ]
    whole = [["", "default", "allowed", "meaning"], ["---"] * 4, *rows]
    return (
        "\n".join(
            "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in whole
        )
        + "\n"
    )


def setup(app: Any) -> None:
    """Have pages read with what a forge could not show."""
    added = {root_doc: navigation, "docs/settings": settings}

    def read(app: Any, page: str, source: list[str]) -> None:
        if page in added:
            source[0] += added[page]()

    app.connect("source-read", read)

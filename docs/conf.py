"""Build the documentation site: the pages of the repository and references made from the code.

`make docs` runs it. Every warning is an error, for example a link without a target.

Pages are plain Markdown and can be read on a forge. For the site this file adds three things:

- tables of settings, faults, scenarios, robots and columns, read from the package;
- a table in place of each paragraph that is only a link to a CSV file in `docs/data`;
- the navigation in the side bar.
"""

import csv
import re
import tomllib
from collections.abc import Iterable, Sequence
from importlib.metadata import version as installed
from itertools import groupby
from pathlib import Path
from typing import Any

from omni_mj.cli import descriptions
from omni_mj.results.text_table import Table, format_markdown
from omni_mj.robot.robot_facts import load_robot
from omni_mj.simulation.log import channel_columns

HERE = Path(__file__).parent

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

NAVIGATION = {
    "Tutorials": [
        "docs/tutorials/tour",
        "docs/tutorials/dead-time",
        "docs/tutorials/alpha-and-slip",
        "docs/tutorials/identify",
    ],
    "How to": [
        "docs/how-to/install",
        "docs/how-to/play",
        "docs/how-to/write-a-scenario",
        "docs/how-to/change-the-dead-time",
        "docs/how-to/add-faults",
        "docs/how-to/add-a-robot",
        "docs/how-to/write-a-controller",
        "docs/how-to/use-from-python",
        "docs/how-to/add-to-your-scene",
        "docs/how-to/put-wheels-on-your-robot",
        "docs/how-to/measure-latency",
        "docs/how-to/connect-your-software",
        "docs/how-to/identify-a-robot",
        "docs/how-to/measure-drag-and-friction",
        "docs/how-to/run-a-sweep",
        "docs/how-to/train-a-policy",
        "docs/how-to/verify-a-run",
        "docs/how-to/make-figures",
        "control/README",
    ],
    "Reference": [
        "docs/reference/commands",
        "docs/reference/settings",
        "docs/reference/faults",
        "docs/reference/scenarios",
        "docs/reference/robots",
        "docs/reference/run-folder",
        "docs/reference/columns",
        "docs/reference/python-api",
        "docs/reference/protocols",
        "models/README",
        "docs/glossary",
    ],
    "Explanation": [
        "docs/explanation/architecture",
        "docs/explanation/physics",
        "docs/explanation/planar-plant",
        "docs/explanation/controllers",
        "docs/explanation/trajectories",
        "docs/explanation/results",
        "docs/explanation/stability-margins",
        "docs/explanation/paper",
        "docs/explanation/identification",
        "docs/explanation/performance",
        "docs/explanation/limits",
    ],
    "Project": ["docs/data/README", "CONTRIBUTING", "CHANGELOG"],
}

# Channel of the log -> what its columns mean. A channel without an entry fails the build.
CHANNEL_MEANINGS = {
    "ref": "pose of the reference",
    "pose": "true pose",
    "vision": "pose measured by the camera; NaN if `vision_valid` is false",
    "vision_valid": "whether the camera detected the robot in this frame",
    "predicted": "pose for which the controller computed its command",
    "command": "command sent to the radio, after the limits, world frame",
    "applied": "command that left the radio and acts until the next frame, world frame",
    "alpha_hat": "alpha estimated by the controller, if it estimates one",
    "latency_hat": "latency estimated by the controller, if it estimates one",
    "wheel_angle": "angle of each wheel, behind the gear",
    "wheel_speed": "speed of each wheel, behind the gear",
    "voltage": "voltage of each motor",
    "current": "current of each motor",
    "voltage_mean": "mean voltage of each motor since the previous frame",
    "current_mean": "mean current of each motor since the previous frame",
    "duty_peak": "largest duty cycle of all motors since the previous frame",
    "voltage_peak": "largest motor voltage since the previous frame",
    "current_peak": "largest motor current since the previous frame",
    "current_limited": "fraction of the time since the previous frame at the current limit",
    "winding": "temperature of each winding",
    "housing": "temperature of each housing",
    "battery": "voltage of the battery",
    "slip": "speed at which the contact point of each wheel slides over the carpet",
}

# Setting -> heading of the reference of robots.
ROBOT_COLUMNS = {
    "body.mass_kg": "mass, kg",
    "body.yaw_inertia_kg_m2": "yaw inertia, kg m²",
    "wheels.azimuths_deg": "azimuths, deg",
    "wheels.arm_m": "arm, m",
    "wheels.radius_m": "wheel radius, m",
    "wheels.rollers": "rollers",
    "motor.gear_ratio": "gear",
    "battery.series_cells": "cells",
    "firmware.rate_hz": "loop rate, Hz",
    "firmware.kp": "kp",
    "firmware.ki": "ki",
    "drivetrain.creep_stiffness": "creep stiffness",
    "carpet.rolling_resistance": "rolling resistance",
}

DATA_LINK = re.compile(
    r"^\[[^\]]*\]\(((?:\.\./)*(?:docs/)?data/([a-z0-9-]+)\.csv)\)$", re.MULTILINE
)


def navigation() -> str:
    """Return the tables of contents that the side bar shows."""
    return "".join(
        f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n"
        + "\n".join(f"/{page}" for page in pages)
        + "\n```\n"
        for heading, pages in NAVIGATION.items()
    )


def settings() -> str:
    """Return a table of settings per section."""
    sections = groupby(descriptions.list_entries("settings"), lambda row: row[0].partition(".")[0])
    return "".join(
        f"\n## [{section}]\n\n" + _settings_table(rows, "none") for section, rows in sections
    )


def faults() -> str:
    """Return a table of the fields of all faults, then a section per kind of fault."""
    text, rows = "\n## Fields of every fault\n\n", []
    for row in descriptions.list_entries("faults"):
        if row[0].startswith("kind = "):
            text += _settings_table(rows, "required")
            text += f"\n## {row[0].removeprefix('kind = ')}\n\n{row[-1]}\n\n"
            rows = []
        else:
            rows.append(row)
    return text + _settings_table(rows, "required")


def scenarios() -> str:
    """Return a table of the scenarios that ship."""
    return "\n" + _table(
        ["scenario", "description"], _named(descriptions.list_entries("scenarios"))
    )


def robots() -> str:
    """Return a table of the robots that ship and one of their numbers."""
    rows = descriptions.list_entries("robots")
    numbers = []
    for name, _ in rows:
        robot_settings = load_robot(name).settings.to_dict()
        values = [
            robot_settings[section][field]
            for section, field in (setting.split(".") for setting in ROBOT_COLUMNS)
        ]
        numbers.append([f"`{name}`", *(_short(value) for value in values)])
    transposed = [list(column) for column in zip(*numbers, strict=True)]
    head = ["", *transposed[0]]
    body = [
        [title, *cells] for title, cells in zip(ROBOT_COLUMNS.values(), transposed[1:], strict=True)
    ]
    return (
        "\n"
        + _table(["robot", "description"], _named(rows))
        + "\n## Numbers\n\n"
        + _table(head, body)
    )


def columns() -> str:
    """Return a table of the columns of trajectory.parquet, for a robot with four wheels."""
    declared = channel_columns(4)
    if declared.keys() != CHANNEL_MEANINGS.keys():
        raise ValueError(
            f"CHANNEL_MEANINGS and the log differ: {declared.keys() ^ CHANNEL_MEANINGS.keys()}"
        )
    rows = [
        [", ".join(f"`{title}`" for title in titles), CHANNEL_MEANINGS[channel]]
        for channel, titles in declared.items()
    ]
    return "\n" + _table(["columns", "meaning"], rows)


def data_table(name: str, path: str) -> str:
    """Return a CSV file of `docs/data` as a table, with its title and the command that made it."""
    source = tomllib.loads((HERE / "data" / "sources.toml").read_text("utf-8"))[name]
    with (HERE / "data" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    origin = "".join(f"    {line}\n" for line in source["command"].strip().splitlines())
    note = f" {source['note']}" if "note" in source else ""
    return (
        f"**{source['title']}**\n\n"
        + _table(head, rows)
        + f"\nData: [{name}.csv]({path}).{note} Command:\n\n{origin}"
    )


def _named(rows: Iterable[Sequence[str]]) -> list[list[str]]:
    return [[f"`{name}`", description] for name, description in rows]


def _settings_table(rows: Iterable[Sequence[str]], without_default: str) -> str:
    """Return settings as a table; `without_default` stands for a missing default."""
    cells = [
        [f"`{name.rpartition('.')[2].strip()}`", default or without_default, unit, allowed, meaning]
        for name, default, unit, allowed, meaning in rows
    ]
    return _table(["name", "default", "unit", "allowed", "meaning"], cells) if cells else ""


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return format_markdown(Table("", list(head), list(map(list, rows)), 0)) + "\n"


def _short(value: Any) -> str:
    return ", ".join(map(_short, value)) if isinstance(value, list | tuple) else f"{value:g}"


GENERATED = {
    root_doc: navigation,
    "docs/reference/settings": settings,
    "docs/reference/faults": faults,
    "docs/reference/scenarios": scenarios,
    "docs/reference/robots": robots,
    "docs/reference/columns": columns,
}


def setup(app: Any) -> None:
    """Add generated text to pages while Sphinx reads them."""

    def extend_page(app: Any, page: str, source: list[str]) -> None:
        source[0] = DATA_LINK.sub(lambda link: data_table(link[2], link[1]), source[0])
        if page in GENERATED:
            source[0] += GENERATED[page]()

    app.connect("source-read", extend_page)

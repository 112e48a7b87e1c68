"""Texts of a recording: the settings as Markdown tables, the events as a log."""

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np
import rerun as rr

from omni_mj.measure import events
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show import markdown
from omni_mj.show.recording.plots import Robot
from omni_mj.show.recording.sink import indexes

ERRORS = (events.STOPPED, events.TEMPERATURE, events.BATTERY)
NOTES = (events.VISION, events.WAY_POINT)


def settings(scenario: Scenario, controllers: Iterable[str], seed: int) -> str:
    """Return all settings in force as Markdown, those that differ from the default in bold."""
    blocks = [
        scenario.description or scenario.name,
        f"Plant {scenario.plant}, controllers {', '.join(controllers)}, seed {seed}. All series are"
        f" sampled at {FRAME_RATE_HZ} Hz, the camera's frames. Settings that differ from the default are bold.",
    ]
    for section, items in groupby(scenario.settings.items(), key=lambda item: item[0].section):
        rows = [
            [setting.name, str(value) if value == setting.default else f"**{value}**", setting.unit, setting.doc]
            for setting, value in items
        ]
        blocks += [f"### {section}", markdown.table(["setting", "value", "unit", "meaning"], rows)]
    if scenario.settings.fault:
        blocks += ["### fault", "\n".join(f"- {fault.told}" for fault in scenario.settings.fault)]
    return "\n\n".join(blocks)


def log(stream: rr.RecordingStream, entity: str, text: str) -> None:
    """Show a Markdown text in place of one that was there before."""
    stream.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def send_events(stream: rr.RecordingStream, robot: Robot, happened: Sequence[events.Event]) -> None:
    """Send what happened to a robot."""
    if happened:
        kinds = [event.kind for event in happened]
        columns = rr.TextLog.columns(
            text=[f"{event.time_s:.2f} s  {robot.name}: {event.text}" for event in happened],
            level=["ERROR" if kind in ERRORS else "INFO" if kind in NOTES else "WARN" for kind in kinds],
            color=[robot.colour] * len(happened),
        )
        stream.send_columns(f"events/{robot.name}", indexes(np.array([event.frame for event in happened])), columns)

"""The texts of a recording: the settings as Markdown tables, the events as a log."""

from collections.abc import Iterable, Sequence
from itertools import groupby

import numpy as np
import rerun as rr

from omni_mj.measure import events
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show.recording.robots import Robot
from omni_mj.show.recording.timelines import indexes

LEVELS = {
    **dict.fromkeys((events.STOPPED, events.TEMPERATURE, events.BATTERY), "ERROR"),
    **dict.fromkeys((events.LIMIT, events.VOLTAGE, events.CURRENT, events.FAULT), "WARN"),
    **dict.fromkeys((events.VISION, events.WAY_POINT), "INFO"),
}


def settings(scenario: Scenario, controllers: Iterable[str], seed: int) -> str:
    """All settings in force, those that differ from the default in bold, as Markdown."""
    lines = [
        f"{scenario.description or scenario.name}",
        "",
        f"Plant {scenario.plant}, controllers {', '.join(controllers)}, seed {seed}. All series are"
        f" sampled at {FRAME_RATE_HZ} Hz, the camera's frames. Settings that differ from the default are bold.",
    ]
    for section, items in groupby(scenario.settings.items(), key=lambda item: item[0].section):
        lines += ["", f"### {section}", "", "| setting | value | unit | meaning |", "| --- | --- | --- | --- |"]
        for setting, value in items:
            shown = value if value == setting.default else f"**{value}**"
            lines.append(f"| {setting.name} | {shown} | {setting.unit} | {setting.doc} |")
    lines += ["", "### fault", ""] * bool(scenario.settings.fault)
    lines += [f"- {fault.told}" for fault in scenario.settings.fault]
    return "\n".join(lines)


def log(stream: rr.RecordingStream, entity: str, markdown: str) -> None:
    """Show a text, in place of one that was there before."""
    stream.log(entity, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


def send_events(stream: rr.RecordingStream, robot: Robot, happened: Sequence[events.Event]) -> None:
    """Send what happened to a robot."""
    if happened:
        frames = np.array([event.frame for event in happened])
        columns = rr.TextLog.columns(
            text=[f"{event.time_s:.2f} s  {robot.name}: {event.text}" for event in happened],
            level=[LEVELS[event.kind] for event in happened],
            color=[robot.colour] * len(happened),
        )
        stream.send_columns(f"events/{robot.name}", indexes(frames), columns)

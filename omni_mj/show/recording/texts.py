"""The texts of a recording: the settings as Markdown tables, the events as a log."""

import numpy as np
import rerun as rr

from omni_mj.measure.events import BATTERY, LIMIT, TEMPERATURE, VISION, VOLTAGE, WAY_POINT, Event
from omni_mj.scenarios.nested import plain
from omni_mj.scenarios.scenario import Scenario
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show.recording import colours
from omni_mj.show.recording.timelines import indexes

LEVELS = {TEMPERATURE: "ERROR", BATTERY: "ERROR", LIMIT: "WARN", VOLTAGE: "WARN", VISION: "INFO", WAY_POINT: "INFO"}


def settings(scenario: Scenario) -> str:
    """All settings in force, those that differ from the default in bold, as Markdown."""
    lines = [
        f"{scenario.description or scenario.name}",
        "",
        f"Plant {scenario.plant}, controllers {', '.join(scenario.labels)}, seed {scenario.seed}. All series are"
        f" sampled at {FRAME_RATE_HZ} Hz, the camera's frames. Settings that differ from the default are bold.",
    ]
    section = None
    for each, value in scenario.settings.items():
        if each.section != section:
            section = each.section
            lines += ["", f"### {section}", "", "| setting | value | unit | meaning |", "| --- | --- | --- | --- |"]
        shown = plain(value) if value == each.default else f"**{plain(value)}**"
        lines.append(f"| {each.name} | {shown} | {each.unit} | {each.doc} |")
    return "\n".join(lines)


def log(stream: rr.RecordingStream, entity: str, markdown: str) -> None:
    """Show a text, in place of one that was there before."""
    stream.log(entity, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


def send_events(stream: rr.RecordingStream, name: str, index: int, happened: list[Event]) -> None:
    """Send events of the `index`-th controller, `name`."""
    if happened:
        frames = np.array([event.frame for event in happened])
        columns = rr.TextLog.columns(
            text=[f"{event.time_s:.2f} s  {name}: {event.text}" for event in happened],
            level=[LEVELS[event.kind] for event in happened],
            color=[colours.of(index)] * len(happened),
        )
        stream.send_columns(f"events/{name}", indexes(frames), columns)

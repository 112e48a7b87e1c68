"""Texts of a recording: documents, and the events as a log."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from omni_mj.measure import events
from omni_mj.show.recording.plots import Robot
from omni_mj.show.recording.sink import indexes

ERRORS = (events.STOPPED, events.TEMPERATURE, events.BATTERY)
NOTES = (events.VISION, events.WAY_POINT)


def log(stream: rr.RecordingStream, entity: str, text: str, kind: rr.MediaType = rr.MediaType.MARKDOWN) -> None:
    """Show a text in place of one that was there before."""
    stream.log(entity, rr.TextDocument(text, media_type=kind), static=True)


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

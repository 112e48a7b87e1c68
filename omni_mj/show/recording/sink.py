"""Rerun streams as every recording uses them: timelines, colours, and flushing that never waits forever."""

import atexit
import ctypes
import uuid

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omni_mj.scenarios.settings import PERIOD_S

Frames = NDArray[np.int_]  # numbers of frames, (n,)
Rgb = tuple[int, int, int]
APPLICATION = "omni-mj"
FRAME, TIME = "frame", "time"  # timelines
FLUSH_S = 30.0  # a block has a megabyte


def open_stream(batcher: rr.ChunkBatcherConfig | None = None) -> rr.RecordingStream:
    """Return a stream that leads nowhere yet; rerun's complaints become exceptions."""
    rr.set_strict_mode(True)  # otherwise rejected data is missing without a word
    stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4(), batcher_config=batcher)
    stream.set_log_time_enabled(False)
    return stream


def indexes(frames: Frames) -> list[rr.TimeColumn]:
    """Return index columns that place rows in `frames`."""
    return [rr.TimeColumn(FRAME, sequence=frames), rr.TimeColumn(TIME, duration=frames * PERIOD_S)]


def pale(colour: Rgb, share: float = 0.5) -> Rgb:
    """Return a colour with a `share` of white."""
    red, green, blue = (round(c + share * (255 - c)) for c in colour)
    return red, green, blue


def flush(stream: rr.RecordingStream) -> None:
    """Wait until everything sent is written.

    If the writer dies of a full disk just as it is told to flush, rerun waits for it without end: there, when the
    stream is finalized, and when the program exits. The latter two are prevented here.

    Raises:
        RuntimeError: It was not written and will not be.
    """
    try:
        stream.flush(timeout_sec=FLUSH_S)
    except RuntimeError:
        atexit.unregister(rr.rerun_shutdown)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))  # never finalized
        raise

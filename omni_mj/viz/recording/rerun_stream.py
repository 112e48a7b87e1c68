"""A rerun stream to a file or a viewer, through which data of frames is sent."""

import atexit
import ctypes
import shutil
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Self

import click
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from omni_control.errors import OmniError
from omni_mj.config import PERIOD_S
from omni_mj.io.atomic_files import check_folder
from omni_mj.viz.recording.viewer import is_listening

Frames = NDArray[np.int_]  # numbers of frames, (n,)
FRAME, TIME = "frame", "time"  # names of the timelines
RESERVED_BYTES = 1_000_000  # disk space for small files: summary, report, provenance
FLUSH_TIMEOUT_S = 30.0  # for one block of about 1 MB


class FrameStream(rr.RecordingStream):
    """A stream whose data has two timelines: the number of the frame, and its time."""

    def send_frames(self, entity: str, frames: Frames, columns: rr.ComponentColumnList) -> None:
        """Send data of an entity, one row per frame."""
        number = rr.TimeColumn(FRAME, sequence=frames)
        time = rr.TimeColumn(TIME, duration=frames * PERIOD_S)
        self.send_columns(entity, [number, time], columns)


class RerunStream:
    """A context manager that sends data to an .rrd file or to a viewer.

    A failure ends the stream and never the program that sends. A missing viewer costs one line on
    stderr.

    Args:
        target: Path of the .rrd file, whose folder must exist, or address of the viewer.
    """

    def __init__(self, target: Path | str) -> None:
        self._target = target
        self._failure = ""
        rr.set_strict_mode(True)  # otherwise rerun drops rejected data silently
        # Data is sent when it is flushed and never by the clock. Otherwise equal runs would differ
        # in the order of chunks.
        config = rr.ChunkBatcherConfig.NEVER()
        self._stream = FrameStream("omni-mj", recording_id=uuid.uuid4(), batcher_config=config)
        self._stream.set_log_time_enabled(False)
        if isinstance(target, str) and not is_listening(target):
            self._fail("the viewer does not answer")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Close the stream.

        Raises:
            OSError: A part of the file could not be written.
        """
        if not self._failure:
            self._stream.disconnect()
        elif isinstance(self._target, Path):
            message = f"the recording could not be written to its end: {self._failure}"
            raise OSError(None, message, str(self._target))

    def _open(self, layout: rrb.Blueprint, has_index: bool) -> None:
        """Begin the file, or connect to the viewer.

        Args:
            layout: Layout of the viewer.
            has_index: Whether the file ends with an index, which is held in memory until then.
        """
        if isinstance(self._target, Path):
            check_folder(self._target)
            self._stream.save(self._target, layout, write_footer=has_index)
        else:
            self._stream.connect_grpc(self._target, default_blueprint=layout)

    def _check_disk(self, table_bytes: float) -> None:
        """Raise OmniError if the disk would not have enough room left for a trajectory table."""
        if isinstance(self._target, Path):
            disk = shutil.disk_usage(self._target.parent)
            if disk.total and disk.free < table_bytes + RESERVED_BYTES:  # total is 0 if unknown
                free_mb = disk.free / 1e6
                raise OmniError(f"the last {free_mb:.1f} MB of the disk are reserved for results")

    def _try_sending(self, send: Callable[..., None], *arguments: object) -> None:
        """Call `send` with its arguments and flush, unless the stream has failed."""
        if self._failure:
            return
        try:
            send(*arguments)
            _flush(self._stream)
        except Exception as error:  # rerun does not document its exceptions
            self._fail(str(error) or type(error).__name__)

    def _fail(self, failure: str) -> None:
        """Give up, because data does not arrive."""
        self._failure = " ".join(failure.split())
        if isinstance(self._target, str):
            message = f"warning: no viewer at {self._target}; the run goes on without it"
            click.echo(message, err=True)


def _flush(stream: rr.RecordingStream) -> None:
    """Wait until everything sent is written.

    If rerun's writer stops because the disk is full, rerun waits for it forever: in a flush without
    a timeout, when the stream is finalized, and when the program exits. This function prevents
    all three.

    Raises:
        RuntimeError: The data was not written and will not be.
    """
    try:
        stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
    except RuntimeError:
        atexit.unregister(rr.rerun_shutdown)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))  # never finalized
        raise

"""A stream to a file or a viewer of rerun."""

import atexit
import ctypes
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Self

import click
import rerun as rr
import rerun.blueprint as rrb

from omni_control.errors import OmniError
from omni_mj.viz.recording.viewer import is_listening

FLUSH_TIMEOUT_S = 30.0  # a block has a megabyte


class RerunStream:
    """A file or a viewer that is fed; a context manager.

    What fails ends the feed, and never what is shown by it. If a viewer is not there, or goes away,
    that costs a line on stderr.

    Args:
        target: Path of the .rrd file, whose folder must exist, or address of the viewer.
    """

    def __init__(self, target: Path | str) -> None:
        self._target, self._failure = target, ""
        rr.set_strict_mode(True)  # otherwise rejected data is missing without a word
        # Sent when it is flushed and never by the clock, or equal runs would differ in the order of
        # chunks.
        never = rr.ChunkBatcherConfig.NEVER()
        self._stream = rr.RecordingStream(
            "omni-mj", recording_id=uuid.uuid4(), batcher_config=never
        )
        self._stream.set_log_time_enabled(False)
        if isinstance(target, str) and not is_listening(target):
            self._fail("nobody answers")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """End it.

        Raises:
            OSError: Not all of a file could be written.
        """
        if not self._failure:  # flushed after all that was sent
            self._stream.disconnect()
        elif isinstance(self._target, Path):
            text = f"the recording could not be written to its end: {self._failure}"
            raise OSError(None, text, str(self._target))

    def _open(self, layout: rrb.Blueprint, footer: bool = True) -> None:
        """Begin the file, or connect to the viewer; without a footer nothing of a file is held in memory."""
        if isinstance(self._target, Path):
            self._stream.save(self._target, layout, write_footer=footer)
        else:
            self._stream.connect_grpc(self._target, default_blueprint=layout)

    def _attempt(self, send: Callable[..., None], *arguments: object) -> None:
        """Call a function and flush, unless the feed has failed; an exception is its failure."""
        if self._failure:
            return
        try:
            send(*arguments)
            _flush(self._stream)
        except Exception as error:  # rerun refused something, or something is wrong here
            self._fail(
                str(error) if isinstance(error, OmniError) else f"{type(error).__name__}: {error}"
            )

    def _fail(self, failure: str) -> None:
        """Give up, as what is sent does not arrive."""
        self._failure = " ".join(failure.split())
        if isinstance(self._target, str):
            click.echo(
                f"warning: no viewer at {self._target}; the run goes on without it", err=True
            )


def _flush(stream: rr.RecordingStream) -> None:
    """Wait until everything sent is written.

    If the writer dies of a full disk just as it is told to flush, rerun waits for it without end:
    there, when the stream is finalized, and when the program exits. The latter two are prevented
    here.

    Raises:
        RuntimeError: It was not written and will not be.
    """
    try:
        stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
    except RuntimeError:
        atexit.unregister(rr.rerun_shutdown)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))  # never finalized
        raise

"""Waiting for rerun's writer, but not for ever.

Where the writer dies of a full disk just as it is told to flush, which one run in fifty met that filled one, rerun
waits for it without end: there, when a stream is thrown away, and when the program ends.
"""

import atexit
import ctypes

import rerun as rr

FLUSH_S = 30.0  # a block has a megabyte


def flush(stream: rr.RecordingStream) -> None:
    """Wait until what was sent is written.

    Raises:
        RuntimeError: it was not, and will not be; then nothing waits for the stream any more.
    """
    try:
        stream.flush(timeout_sec=FLUSH_S)
    except RuntimeError:
        atexit.unregister(rr.rerun_shutdown)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(stream))  # else it is finalized, which waits
        raise

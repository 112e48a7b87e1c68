"""A run in a viewer while it goes on."""

import os
import re
import sys

import click
import rerun as rr

from omni_control.errors import OmniError
from omni_mj.scenarios.settings import FRAME_RATE_HZ
from omni_mj.show.recording.stream import Recording
from omni_mj.show.recording.viewer import Viewer, answers
from omni_mj.simulate.simulation import Simulation

EXAMPLE = "rerun+http://127.0.0.1:9876/proxy"  # of a viewer that was started without options


class LiveRecording(Recording):
    """A run fed to a viewer; one that is not there, or goes away, costs a line on stderr and nothing else.

    Args:
        url: of the viewer.
        simulation: whose log is shown.
    """

    def __init__(self, url: str, simulation: Simulation) -> None:
        super().__init__(simulation, block_frames=FRAME_RATE_HZ // 2, live=True)
        self._url = url
        if not answers(url):
            self._fail(RuntimeError("nobody answers"))

    def _connect(self, stream: rr.RecordingStream) -> None:
        stream.connect_grpc(self._url, default_blueprint=self._blueprint())

    def _fail(self, failure: Exception) -> None:
        if not self._failure:
            click.echo(f"warning: no viewer at {self._url}; the run goes on without it", err=True)
        super()._fail(failure)


def check(url: str) -> str:
    """Return `url` if it can be that of a viewer.

    Raises:
        OmniError: it cannot.
    """
    if not re.fullmatch(r"rerun(\+https?)?://[^/\s:]+:\d{1,5}/proxy", url):
        raise OmniError(f"--connect needs the address of a rerun viewer, such as {EXAMPLE}, not {url!r}")
    return url


def open_viewer() -> str:
    """Open a viewer's window, which outlives this process, and return the viewer's address.

    Raises:
        OmniError: there is no display, or the viewer cannot use it.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise OmniError("--view needs a display, and there is none; the recording can be opened where there is one")
    return Viewer("--expect-data-soon").url

"""Rerun viewers as processes of their own."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

from rerun.experimental import ViewerClient

from omni_control.errors import OmniError

START_S, ANSWER_S = 60.0, 2.0  # for a viewer to show its window, and to answer once it does
EXAMPLE = "rerun+http://127.0.0.1:9876/proxy"  # of a viewer that was started without options
# A viewer would send usage statistics, unless its configuration says otherwise; and ask whether
# there is a newer one, and for examples, which nothing turns off: what it asks of others it asks of
# a proxy, and there is none.
NOBODY = "http://127.0.0.1:9"
QUIET = {
    "http_proxy": NOBODY,
    "https_proxy": NOBODY,
    "all_proxy": NOBODY,
    "no_proxy": "127.0.0.1,localhost",
}
QUIET |= {name.upper(): value for name, value in QUIET.items()}
QUIET |= {"XDG_CONFIG_HOME": str(Path(__file__).parent / "viewer_config")}


class Viewer:
    """A viewer that was started; it listens on this machine alone, and asks nothing of any other.

    Args:
        options: Options of the command `rerun`.
        file: File to read from its standard input, with the option `-`.

    Attributes:
        url: Its address.

    Raises:
        OmniError: It cannot show its window, or draw without one.
    """

    def __init__(self, *options: str, file: Path | None = None) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        command = [sys.executable, "-m", "rerun", *options, "--bind", "127.0.0.1", "--port", port]
        self._output = output = tempfile.TemporaryFile("w+")  # noqa: SIM115 (as long as the viewer)
        with open(file or os.devnull, "rb") as stdin:
            # In a session of its own, which outlives this process and is ended as a whole.
            self._process = subprocess.Popen(
                command,
                stdin=stdin,
                stdout=output,
                stderr=output,
                start_new_session=True,
                env=os.environ | QUIET,
            )
        deadline = time.monotonic() + START_S
        while not self._shows():
            if self._process.poll() is not None or time.monotonic() > deadline:
                self.stop()
                raise OmniError(f"the rerun viewer does not start: {self.error_message()}")
            time.sleep(0.05)

    def error_message(self) -> str:
        """Return why it ended, in its own words."""
        self._output.seek(0)
        match = re.search(r"(?:Error: |panicked at ')(.*)", self._output.read())
        return match[1] if match else "it does not answer"

    def stop(self) -> None:
        """End it."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGTERM)
        self._process.wait()

    def _shows(self) -> bool:
        """Return whether its window answers, not only its server."""
        try:
            return is_listening(self.url) and bool(ViewerClient.connect(self.url).get_state())
        except (RuntimeError, OSError):
            return False


def is_listening(url: str) -> bool:
    """Return whether anybody listens at an address like rerun+http://127.0.0.1:9876/proxy."""
    address = urlsplit(url)
    try:
        socket.create_connection((address.hostname or "", address.port or 0), ANSWER_S).close()
        return True
    except OSError:
        return False


def validate_url(url: str) -> str:
    """Return `url` if it can be that of a viewer.

    Raises:
        OmniError: It cannot.
    """
    if not re.fullmatch(r"rerun(\+https?)?://[^/\s:]+:\d{1,5}/proxy", url):
        raise OmniError(
            f"--connect needs the address of a rerun viewer, such as {EXAMPLE}, not {url!r}"
        )
    return url


def open_viewer() -> str:
    """Open a viewer's window, which outlives this process, and return the viewer's address.

    Raises:
        OmniError: There is no display, or the viewer cannot use it.
    """
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise OmniError(
            "--view needs a display, and there is none; the recording can be opened where there is one"
        )
    return Viewer("--expect-data-soon").url

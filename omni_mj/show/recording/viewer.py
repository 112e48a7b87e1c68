"""Rerun viewers, which are processes of their own."""

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
# A viewer would send usage statistics, unless its configuration says otherwise; and ask whether there is a newer one,
# and for examples, which nothing turns off: what it asks of others it asks of a proxy, and there is none.
NOBODY = "http://127.0.0.1:9"
QUIET = {"http_proxy": NOBODY, "https_proxy": NOBODY, "all_proxy": NOBODY, "no_proxy": "127.0.0.1,localhost"}
QUIET |= {name.upper(): value for name, value in QUIET.items()}
QUIET |= {"XDG_CONFIG_HOME": str(Path(__file__).parent / "quiet")}


def answers(url: str) -> bool:
    """Return whether anybody listens at an address like rerun+http://127.0.0.1:9876/proxy."""
    address = urlsplit(url)
    try:
        socket.create_connection((address.hostname or "", address.port or 0), ANSWER_S).close()
        return True
    except OSError:
        return False


def check(url: str) -> str:
    """Return `url` if it can be that of a viewer.

    Raises:
        OmniError: It cannot.
    """
    if not re.fullmatch(r"rerun(\+https?)?://[^/\s:]+:\d{1,5}/proxy", url):
        raise OmniError(f"--connect needs the address of a rerun viewer, such as {EXAMPLE}, not {url!r}")
    return url


def open_viewer() -> str:
    """Open a viewer's window, which outlives this process, and return the viewer's address.

    The viewer listens on this machine alone, and asks nothing of any other.

    Raises:
        OmniError: There is no display, or the viewer cannot use it.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise OmniError("--view needs a display, and there is none; the recording can be opened where there is one")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    command = [sys.executable, "-m", "rerun", "--expect-data-soon", "--bind", "127.0.0.1", "--port", port]
    with tempfile.TemporaryFile("w+") as output:
        # In a session of its own, which is ended as a whole.
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True,
            env=os.environ | QUIET,
        )  # fmt: skip
        deadline = time.monotonic() + START_S
        while not _shows(url):
            if process.poll() is not None or time.monotonic() > deadline:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGTERM)
                process.wait()
                output.seek(0)
                match = re.search(r"(?:Error: |panicked at ')(.*)", output.read())
                reason = match[1] if match else "it does not answer"
                raise OmniError(f"the rerun viewer does not start: {reason}")
            time.sleep(0.05)
    return url


def _shows(url: str) -> bool:
    """Return whether a viewer's window answers, not only its server."""
    try:
        return answers(url) and bool(ViewerClient.connect(url).get_state())
    except (RuntimeError, OSError):
        return False

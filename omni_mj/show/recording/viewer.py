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
# A viewer would send usage statistics, unless its configuration says otherwise; and ask whether there is a newer one,
# and for examples, which nothing turns off: what it asks of others it asks of a proxy, and there is none.
NOBODY = "http://127.0.0.1:9"
QUIET = {f"{scheme}_proxy": NOBODY for scheme in ("http", "https", "all")} | {"no_proxy": "127.0.0.1,localhost"}
QUIET |= {name.upper(): value for name, value in QUIET.items()}
QUIET |= {"XDG_CONFIG_HOME": str(Path(__file__).parent / "quiet")}


class Viewer:
    """A viewer that was started; it listens on this machine alone, and asks nothing of any other.

    Args:
        options: of the command `rerun`.
        file: to read from its standard input, with the option `-`.

    Attributes:
        url: its address.

    Raises:
        OmniError: it cannot show its window, or draw without one.
    """

    def __init__(self, *options: str, file: Path | None = None) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        command = [sys.executable, "-m", "rerun", *options, "--bind", "127.0.0.1", "--port", port]
        self._said = said = tempfile.TemporaryFile("w+")  # noqa: SIM115 (as long as the viewer)
        with open(file or os.devnull, "rb") as stdin:
            # In a session of its own, which outlives this process and is ended as a whole.
            self._process = subprocess.Popen(
                command, stdin=stdin, stdout=said, stderr=said, start_new_session=True, env=os.environ | QUIET
            )
        if not self._shows():
            self.stop()
            raise OmniError(f"the rerun viewer does not start: {self.complaint()}")

    def complaint(self) -> str:
        """Why it ended, in its own words."""
        self._said.seek(0)
        found = re.search(r"Error: (.*)|panicked at '(.*)'", self._said.read())
        return next(filter(None, found.groups())) if found else "it does not answer"

    def stop(self) -> None:
        """End it."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGTERM)
        self._process.wait()

    def _shows(self) -> bool:
        """Wait until its window answers, not only its server; whether it ever does."""
        deadline = time.monotonic() + START_S
        while self._process.poll() is None and time.monotonic() < deadline:
            if answers(self.url):
                try:
                    ViewerClient.connect(self.url).get_state()
                    return True
                except (RuntimeError, OSError):
                    pass
            time.sleep(0.05)
        return False


def answers(url: str) -> bool:
    """Whether anybody listens at an address like rerun+http://127.0.0.1:9876/proxy."""
    address = urlsplit(url)
    try:
        socket.create_connection((address.hostname or "", address.port or 0), ANSWER_S).close()
        return True
    except OSError:
        return False

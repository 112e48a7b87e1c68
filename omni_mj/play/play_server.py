"""Server of the page: one loop steps the robots, applies what the page asks for, and shows them."""

import gc
import logging
import math
import re
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, redirect_stdout, suppress
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import viser
from websockets.asyncio import server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from omni_control.errors import OmniError
from omni_mj.config import PERIOD_S, plugins
from omni_mj.config.scenario import Scenario
from omni_mj.live.sockets import LOOPBACK
from omni_mj.play.play_page import PlayPage
from omni_mj.play.play_session import PlaySession
from omni_mj.play.state_links import load_link
from omni_mj.play.time_limit import LIMIT_S, USER_LIMIT_S, TimeLimitError, limit_time
from omni_mj.studies.run_scenario import StoppedError, quiet_mujoco

DEFAULT_PORT = 8642
PLOT_PERIOD_S = 0.2
IDLE_S = 0.03  # between checks while nothing moves
CLOSED_S = 5.0  # without a page, after the last one was closed, until the program ends
MAX_LAG_S = 0.1  # behind real time, after which frames are dropped

REQUEST_S = 5.0  # until a connection must have sent its request

LoadScenario = Callable[[str | None, Mapping[str, Any]], Scenario]


class PlayServer:
    """A session, its page and the loop.

    All pages show the same session. Their requests are carried out by the loop, between two frames.

    Args:
        load_scenario: Returns a scenario, given its name (None: that of the command line) and
            values of its top level, such as the plant.
        check_stop: Raises `StoppedError` after a signal.
        exit_at_once: Ends the process with a message, even if users' code hangs.
        port: Port of the page; 0 for any. Default: 8642, or any if that is in use.
        record: Recording file to write.

    Attributes:
        session: The session.
        speed: Simulated time over real time; 0 pauses.
        repeat: Whether the session restarts at the end of the reference.
        url: Address of the page.

    Raises:
        OmniError: The scenario is wrong, or the port is in use.
        StoppedError: A signal came meanwhile.
    """

    def __init__(
        self,
        load_scenario: LoadScenario,
        check_stop: Callable[[], None],
        exit_at_once: Callable[[str], None],
        port: int | None = None,
        record: Path | None = None,
    ) -> None:
        quiet_mujoco()
        self._load_scenario, self.speed, self.repeat = load_scenario, 1.0, record is None
        self._check_stop, self._exit_at_once = check_stop, exit_at_once
        self._requests: dict[str, Callable[[], None]] = {}
        self._real_time_factor = math.inf
        self._seen_page_at: float | None = None
        try:  # users' files may import large packages
            with self._limit_time(user_limit_s=LIMIT_S):
                scenario = load_scenario(None, {})
                self.session = PlaySession(scenario, record=record)
        except TimeLimitError as error:
            check_stop()
            raise OmniError(str(error)) from error
        self._own_name = scenario.name
        self._file_times: dict[str, float] = {}
        self._viser = self._start_viser(port)
        try:
            self.url = f"http://{LOOPBACK}:{self._viser.get_port()}/"
            self.page = PlayPage(self, self._viser)
        except BaseException:
            self.close()
            raise

    def request(self, key: str, action: Callable[[], None]) -> None:
        """Carry out an action between two frames. It replaces a waiting one of the same key."""
        self._requests[key] = action

    def load(self, name: str, top_level: Mapping[str, Any]) -> None:
        """Load a scenario by the name that the menu shows, and restart."""
        own_name = self._own_name == name
        self.session.restart(self._load_scenario(None if own_name else name, top_level))

    def run(self) -> None:
        """Run until the last page is closed.

        Raises:
            StoppedError: A signal came.
        """
        gc.freeze()  # the objects of imports, so that collections take 1 ms, not 0.1 s
        n_frames, due = 0, time.monotonic()
        plotted = rate_measured = due
        while not self._is_left():
            self._check_stop()
            if self._requests:
                self._carry_out_requests()
                rate_measured, n_frames = time.monotonic(), 0
            if self.speed and self._viser.get_clients():
                self._advance()
                n_frames += 1
                self.page.plots.add(self.session.snapshot)
                if self.session.snapshot.has_ended and self.repeat:
                    self.request("repeat", self.session.restart)
                due = max(due + PERIOD_S / (self.speed or 1), time.monotonic() - MAX_LAG_S)
            else:
                due = rate_measured = max(due, time.monotonic() + IDLE_S)
                n_frames = 0
            self.page.view.update(self.session.snapshot)
            now = time.monotonic()
            if now - plotted > PLOT_PERIOD_S:
                plotted = now
                self._reload_saved_files()
                self.page.show_status(self._real_time_factor)
            if now - rate_measured > 1:
                self._real_time_factor = n_frames * PERIOD_S / (now - rate_measured)
                rate_measured, n_frames = now, 0
            time.sleep(max(0.0, due - time.monotonic()))

    def close(self) -> None:
        """Stop the server, and finish the recording."""
        with redirect_stdout(None):
            self._viser.stop()
        self.session.close()

    def _limit_time(self, user_limit_s: float = USER_LIMIT_S) -> AbstractContextManager[None]:
        """Limit the time of a block; see `limit_time`."""
        return limit_time(self._must_end, self._end_at_once, user_limit_s)

    def _must_end(self) -> bool:
        """Return whether a signal came, or all pages are closed."""
        with suppress(StoppedError):
            self._check_stop()
            return self._seen_page_at is not None and self._is_left()
        return True

    def _end_at_once(self, message: str) -> None:
        """End the process. Finish the recording if there is one."""
        with suppress(BaseException):
            self.session.close()
        self._exit_at_once(message)

    def _advance(self) -> None:
        """Advance by a frame. Pause if that takes too long."""
        try:
            with self._limit_time():
                self.session.advance()
        except TimeLimitError as error:
            self.page.show_message(f"Paused: {error}. Restart, or choose other controllers.")
            self.speed = 0.0

    def _carry_out_requests(self) -> None:
        """Carry out what the pages asked for. Errors are shown on the page."""
        while self._requests:
            key = next(iter(self._requests))
            action = self._requests.pop(key)
            self._real_time_factor = math.inf  # unknown
            if key != "repeat":
                self.page.show_message("")
            for step in (action, partial(self.page.refresh, key)):
                try:
                    with self._limit_time():
                        step()
                except (OmniError, TimeLimitError) as error:
                    self.page.show_message(str(error))
        gc.collect()  # a restart leaves cycles with 2.4 MB of arrays

    def _reload_saved_files(self) -> None:
        """Restart with the new code of a controller's file that was saved."""
        for controller in self.session.scenario.controllers:
            if not isinstance(controller, str):
                spec = plugins.format_controller_spec(controller)
                with suppress(OSError):  # an editor may be replacing it
                    modified = Path(spec.rpartition(":")[0]).stat().st_mtime
                    if modified != self._file_times.setdefault(spec, modified):
                        self._file_times[spec] = modified
                        self.request(f"reload {spec}", partial(self._reload, controller))

    def _reload(self, spec: plugins.ControllerSpec) -> None:
        """Restart with the new code of a file, also if its old code paused the session."""
        self.session.reload_controller(spec)
        self.page.resume()

    def _is_left(self) -> bool:
        """Return whether there were pages, and all of them are closed."""
        now = time.monotonic()
        if self._viser.get_clients():
            self._seen_page_at = now
        return self._seen_page_at is not None and now - self._seen_page_at > CLOSED_S

    def _start_viser(self, port: int | None) -> viser.ViserServer:
        """Start viser on a port, with `_check_request` before its own answers.

        viser has no options for both, so its call of websockets' `serve` is completed.

        Raises:
            OmniError: The port is in use, or viser does not call `serve`.
        """
        listener, serve = _listen(port), server.serve
        logger = logging.getLogger(__name__)
        logger.setLevel(logging.CRITICAL)  # what others send is no error of this program

        def serve_checked(
            handler: Any, _host: str, _port: int, *, process_request: Any, **options: Any
        ) -> Any:
            def answer(connection: server.ServerConnection, request: Request) -> Response | None:
                return self._check_request(request) or process_request(connection, request)

            options |= {"open_timeout": REQUEST_S, "logger": logger}
            return serve(handler, sock=listener, process_request=answer, **options)

        server.serve = serve_checked  # type: ignore[assignment,misc]
        try:
            with redirect_stdout(None):  # viser prints its address, which is not that of the page
                web = viser.ViserServer(LOOPBACK, port=0, verbose=False)
        finally:
            server.serve = serve  # type: ignore[misc]
        if web.get_port() != listener.getsockname()[1]:
            web.stop()
            raise OmniError("this version of viser has another server; install viser 1.1")
        return web

    def _check_request(self, request: Request) -> Response | None:
        """Return the refusal of a request or the answer to a link, or None for viser's answer.

        Pages of other sites may not connect. They may only lead to this page, by a link. Programs
        other than browsers send no fetch metadata, whose headers begin with Sec-.
        """

        def get(name: str) -> str:
            # Several headers of a name, joined, are none that is accepted.
            return ",".join(request.headers.get_all(name)).lower()

        host = get("Host")
        is_this_host = re.fullmatch(rf"({re.escape(LOOPBACK)}|localhost)(:\d+)?", host)
        is_same_origin = get("Sec-Fetch-Site") in ("", "same-origin", "none")
        is_prefetch = get("Sec-Purpose") or get("Purpose") or get("X-Moz")
        is_navigation = (
            get("Sec-Fetch-Mode") in ("", "navigate")
            and get("Sec-Fetch-Dest") in ("", "document")
            and not is_prefetch
        )
        is_link = request.path.startswith("/?")
        is_allowed = is_navigation or (is_same_origin and not is_link)
        if not (is_this_host and is_allowed and get("Origin") in ("", f"http://{host}")):
            return _make_response(HTTPStatus.FORBIDDEN)
        if self._seen_page_at is not None:  # it may be reloaded before it is complete
            self._seen_page_at = time.monotonic()
        query = urlsplit(request.path).query if is_link else ""
        if not query:
            return None
        self.request("link", lambda: self.session.restart(load_link(query)))
        return _make_response(HTTPStatus.SEE_OTHER, Location="/")


def _listen(port: int | None) -> socket.socket:
    """Return a socket that listens on a port; see `PlayServer`.

    Raises:
        OmniError: The port is in use.
    """
    for candidate in (DEFAULT_PORT, 0) if port is None else (port,):
        with suppress(OSError):
            return socket.create_server((LOOPBACK, candidate))
    raise OmniError(f"port {port} is in use or not allowed; choose another one by --port")


def _make_response(status: HTTPStatus, **headers: str) -> Response:
    """Return an answer without content."""
    return Response(status, status.phrase, Headers({"Content-Length": "0", **headers}))

"""A live run against the peer of `peer.py`, over real sockets, which waits for commands: nothing depends on how busy
this computer is.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from omni_control import Controller
from omni_mj.live import session
from omni_mj.live.drive import Live
from omni_mj.live.notes import Notes
from omni_mj.live.session import Options
from omni_mj.live.sockets import LOOPBACK, Address, Receiver
from omni_mj.scenarios.scenario import Scenario, scenario

PEER = [sys.executable, str(Path(__file__).with_name("peer.py"))]
ROUTE = {"waypoints": [[0, 0], [0.5, 0.3], [0.5, 0.0]], "settle_s": 0.3}
# What is believed of robots that do as they are told; of alpha, as on equation 7's plant, nothing.
EXACT = {"lag_s": 0.0, "drag_m_s": 0.0, "creep_s2_m": 0.0, "alpha_forward": 0.0, "alpha_sideways": 0.0}


def free_port() -> int:
    receiver = Receiver(Address(LOOPBACK, 0))
    receiver.close()
    return receiver.address.port


@contextmanager
def peer(*said: object) -> Iterator[Options]:
    """A simulator, for as long as the block lasts; how to connect to it."""
    vision, port = free_port(), free_port()
    command = [*PEER, "--vision", f"{LOOPBACK}:{vision}", "--port", str(port), "--lockstep", *map(str, said)]
    process = subprocess.Popen(command)
    try:
        yield Options(Address(LOOPBACK, vision), Address(LOOPBACK, port), pace="vision", listen_s=0.4)
    finally:
        process.kill()
        process.wait()


def on_wire(controller: str | type[Controller], **sections: object) -> Scenario:
    sections = {"reference": ROUTE, "control": EXACT, **sections}
    return scenario("rect", plant="live", controllers=[controller], **sections)


def driven(chosen: Scenario, options: Options) -> Live:
    notes = Notes()
    session.check(chosen, options)
    with session.listening(options, notes) as link, session.ready(chosen, options, link, notes) as live:
        live.run()
    return live

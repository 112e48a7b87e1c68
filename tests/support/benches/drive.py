"""Bench of `omni-mj drive` against the peer of `peer.py`, over real sockets.

The peer waits for commands: nothing depends on how busy this computer is.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import peer as peer_program
from serving import LOOPBACK, free_port

from omni_control import Controller
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.live import latency_fit, session
from omni_mj.live.live_loop import Live
from omni_mj.live.session import ConnectionOptions
from omni_mj.live.sockets import MessageCounter
from omni_mj.simulation.simulation import Simulation

PEER = [sys.executable, str(Path(peer_program.__file__))]
NOBODY = f"{LOOPBACK}:9"
ROUTE = {"waypoints": [[0, 0], [0.5, 0.3], [0.5, 0.0]], "settle_s": 0.3}
# What is believed of robots that do as they are told; of alpha, as on equation 7's plant, nothing.
EXACT = {
    "assumed_lag_s": 0.0,
    "assumed_drag_m_s": 0.0,
    "assumed_creep_s2_m": 0.0,
    "assumed_alpha_forward": 0.0,
    "assumed_alpha_sideways": 0.0,
}


@contextmanager
def started(ports: tuple[int, int], *said: object) -> Iterator["subprocess.Popen[str]"]:
    """A simulator for the duration of the block; it sends vision to one port, reads another."""
    vision, port = ports
    command = [*PEER, "--vision", f"{LOOPBACK}:{vision}", "--port", str(port), *map(str, said)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def peer(*said: object, **options: Any) -> Iterator[ConnectionOptions]:
    """A simulator that waits for commands; how to connect to it, with more options."""
    ports = free_port(), free_port()
    vision, commands = (f"{LOOPBACK}:{port}" for port in ports)
    with started(ports, "--lockstep", *said):
        yield replace(ConnectionOptions(vision, commands, pace="vision", listen_s=0.4), **options)


def on_wire(controller: str | type[Controller], **sections: object) -> Scenario:
    sections = {"reference": ROUTE, "control": EXACT, **sections}
    return load_scenario("rect", plant="live", controllers=[controller], **sections)


def driven(chosen: Scenario, options: ConnectionOptions) -> Live:
    session.check_drivable(chosen, options)
    with (
        session.open_vision(options, MessageCounter()) as frame_clock,
        session.prepare_drive(chosen, options, frame_clock) as live,
    ):
        live.run()
    return live


def summary(live: Live) -> dict[str, Any]:
    """As in link.json."""
    return latency_fit.summarize(live)


def in_process(live: Live, delay: int) -> Simulation:
    """The kinematic loop with exact robots, a dead time, and vision without noise."""
    settings = live.scenario.settings.replace(
        radio={"delay_frames": delay},
        kinematic={"alpha_low": 1.0, "alpha_high": 1.0},
        vision={"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
    )
    simulation = Simulation(live.scenario.replace(plant="kinematic", settings=settings))
    simulation.run()
    return simulation

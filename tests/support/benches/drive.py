"""Helpers to test `omni-mj drive` with the simulator of `peer_simulator.py`, over real sockets.

The simulator waits for commands, so results do not depend on the load of this computer.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import peer_simulator as peer_program
from serve_client import LOOPBACK, free_port

from omni_control import Controller
from omni_mj.config.scenario import Scenario, load_scenario
from omni_mj.live import drive_setup, latency_fit
from omni_mj.live.drive_setup import ConnectionOptions
from omni_mj.live.live_loop import Live
from omni_mj.live.sockets import MessageCounter
from omni_mj.simulation.simulation import Simulation

PEER = [sys.executable, str(Path(peer_program.__file__))]
UNUSED_ADDRESS = f"{LOOPBACK}:9"
ROUTE = {"waypoints": [[0, 0], [0.5, 0.3], [0.5, 0.0]], "settle_s": 0.3}
# Assumptions about robots that follow commands exactly; alpha is unknown, as for equation 7
EXACT = {
    "assumed_lag_s": 0.0,
    "assumed_friction_loss_m_s": 0.0,
    "assumed_creep_s2_m": 0.0,
    "assumed_alpha_forward": 0.0,
    "assumed_alpha_sideways": 0.0,
}


@contextmanager
def run_peer(ports: tuple[int, int], *arguments: object) -> Iterator["subprocess.Popen[str]"]:
    """Run a simulator; it sends vision to the first port, and reads commands at the second."""
    vision, port = ports
    command = [*PEER, "--vision", f"{LOOPBACK}:{vision}", "--port", str(port), *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def connect_peer(*arguments: object, **options: Any) -> Iterator[ConnectionOptions]:
    """Run a simulator that waits for commands; yield options that connect to it."""
    ports = free_port(), free_port()
    vision, commands = (f"{LOOPBACK}:{port}" for port in ports)
    with run_peer(ports, "--lockstep", *arguments):
        yield replace(connect_in_lockstep(vision, commands), **options)


def connect_in_lockstep(vision: str, commands: str, pulse: bool = True) -> ConnectionOptions:
    """Return options of a drive that follows the images of a simulator at two addresses."""
    return ConnectionOptions(
        vision,
        commands,
        LOOPBACK,
        color="blue",
        ids=(),
        pace="vision",
        radio=None,
        wait_s=10.0,
        duration_s=None,
        pulse=pulse,
        overrides=(),
        listen_s=0.4,
    )


def live_scenario(controller: str | type[Controller], **sections: object) -> Scenario:
    """Return the scenario `rect` on the plant live, with other sections replaced."""
    sections = {"reference": ROUTE, "control": EXACT, **sections}
    return load_scenario("rect", plant="live", controllers=[controller], **sections)


def drive_live(chosen: Scenario, options: ConnectionOptions) -> Live:
    """Drive a scenario to its end."""
    drive_setup.check_drivable(chosen, options)
    with (
        drive_setup.open_vision(options, MessageCounter()) as frame_clock,
        drive_setup.prepare_drive(chosen, options, frame_clock) as live,
    ):
        live.run()
    return live


def summarize(live: Live) -> dict[str, Any]:
    """Return the content of link.json."""
    return latency_fit.summarize(live)


def simulate_in_process(live: Live, delay: int) -> Simulation:
    """Return the run on the plant kinematic with alpha 1, a dead time, and ideal vision."""
    settings = live.scenario.settings.replace(
        radio={"delay_frames": delay},
        kinematic={"alpha_low": 1.0, "alpha_high": 1.0},
        vision={"position_noise_m": 0, "heading_noise_rad": 0, "miss_probability": 0},
    )
    simulation = Simulation(live.scenario.replace(plant="kinematic", settings=settings))
    simulation.run()
    return simulation

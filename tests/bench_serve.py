"""`make bench`: what `serve` costs of a core in real time, and how regularly its detections leave."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from omni_mj.live import serve_line_up
from omni_mj.live.serve_pitch import Pitch
from omni_mj.live.serve_server import Ports, Server
from omni_mj.live.sockets import LOOPBACK, Address
from omni_mj.live.wire.simulation import Team

SECONDS, ROUNDS = 4.0, 3
CASES = (
    ("1", "0", "rollers", 0.15),
    ("1", "0", "two-rollers", 0.0),
    ("6", "6", "two-rollers", 0.5),
    ("6", "6", "rollers", 0.0),
)


def serve(blue: str, yellow: str, wheels: str) -> tuple[float, np.ndarray]:
    """Share of a core, and lateness of detections in s, of robots that a client commands 60 times a second."""
    chosen = serve_line_up.load(None, [f"wheels.model={wheels}"], {})
    poses = serve_line_up.poses(*(serve_line_up.numbers(team, "--blue") for team in (blue, yellow)), None)
    server = Server(Pitch({Team.BLUE: chosen, Team.YELLOW: chosen}, poses), Ports(0, 0, 0, Address(LOOPBACK, 10020)))
    script = Path(__file__).parent / "support" / "bench_client.py"
    client = subprocess.Popen([sys.executable, script, *map(str, server.ports[1:]), blue, yellow])
    try:
        server.run(until_s=0.5)
        server.lateness.clear()
        began, used = time.perf_counter(), time.process_time()
        server.run(until_s=0.5 + SECONDS)
        return (time.process_time() - used) / (time.perf_counter() - began), np.array(server.lateness)
    finally:
        client.kill()
        client.wait()
        server.close()


if __name__ == "__main__":
    print("serve in real time: share of one core, best of", ROUNDS, "and detections' lateness, ms (all rounds)")
    print("robots  wheels        core   budget       5 %     50 %     95 %     99 %      most")
    for blue, yellow, wheels, budget in CASES:
        rounds = [serve(blue, yellow, wheels) for _ in range(ROUNDS)]
        late = 1e3 * np.concatenate([late for _, late in rounds])
        shares = "".join(f"{np.quantile(late, q):9.2f}" for q in (0.05, 0.5, 0.95, 0.99, 1.0))
        robots, limit = int(blue) + int(yellow), f"{budget:8.0%}" if budget else " " * 8
        print(f"{robots:6d}  {wheels:12s} {min(share for share, _ in rounds):5.0%} {limit} {shares}", flush=True)

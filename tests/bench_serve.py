"""`make bench`: what `serve` costs of a core in real time, and how regularly its detections leave."""

import subprocess
import sys
import time
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from omni_mj.onboard.kernel import compiled

from omni_mj.live.serve import line_up
from omni_mj.live.serve.pitch import Pitch
from omni_mj.live.serve.ports import Ports
from omni_mj.live.serve.server import Server
from omni_mj.live.sockets import LOOPBACK, Address
from omni_mj.live.wire.simulation import Team
from omni_mj.plants import alone
from omni_mj.scenarios.settings import PERIOD_S

SECONDS = 8.0
CASES = (
    ("1", "0", "rollers", 0.15),
    ("1", "0", "two-rollers", 0.0),
    ("6", "6", "two-rollers", 0.5),
    ("6", "6", "rollers", 0.0),
)


def serve(blue: str, yellow: str, wheels: str, kernel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """CPU time of each frame, and of bare steps of the same robots for as long, s; lateness of detections, s.

    A client commands all robots 60 times a second.
    """
    chosen = line_up.load(None, [f"wheels.model={wheels}", f"physics.kernel={kernel}"], {})
    poses = line_up.poses(*(line_up.numbers(team, "--blue") for team in (blue, yellow)), None)
    server = Server(Pitch({Team.BLUE: chosen, Team.YELLOW: chosen}, poses), Ports(0, 0, 0, Address(LOOPBACK, 10020)))
    script = Path(__file__).parent / "support" / "bench_client.py"
    client = subprocess.Popen([sys.executable, script, *map(str, server.ports[1:]), blue, yellow])
    used, bare = list[float](), list[float]()
    try:
        server.run(until_s=0.5)
        server.publisher.lateness.clear()
        server.after_frame = lambda: used.append(time.process_time())
        server.run(until_s=0.5 + SECONDS)
        plant, batch = server.pitch.plant, server.pitch.plant._batch
        step = partial(compiled(alone.step), batch.stepping) if isinstance(batch, alone.Alone) else batch.step
        for _ in range(60):
            began = time.process_time()
            for _ in range(plant.cycles):
                step()
            bare.append(time.process_time() - began)
        return np.diff(used), np.array(bare), np.array(server.publisher.lateness)
    finally:
        client.kill()
        client.wait()
        server.close()


if __name__ == "__main__":
    print(
        "serve in real time: CPU time of a frame, share of 1/60 s of a core; other work on the machine makes it more,"
    )
    print(
        "so that the fastest tenth of the frames tells most. Bare: physics steps alone. Then lateness of detections, ms"
    )
    print("robots  wheels       kernel budget   10 %  50 %  90 %   bare 10 %    late 5 %     50 %     95 %     99 %")
    for (blue, yellow, wheels, budget), kernel in product(CASES, ("numpy", "numba")):
        used, bare, late = serve(blue, yellow, wheels, kernel)
        shares = "".join(f"{np.quantile(used, q) / PERIOD_S:6.0%}" for q in (0.1, 0.5, 0.9))
        lateness = "".join(f"{1e3 * np.quantile(late, q):9.2f}" for q in (0.05, 0.5, 0.95, 0.99))
        robots, limit = int(blue) + int(yellow), f"{budget:6.0%}" if budget else " " * 6
        steps = f"{np.quantile(bare, 0.1) / PERIOD_S:11.0%}"
        print(f"{robots:6d}  {wheels:12s} {kernel} {limit} {shares} {steps}   {lateness}", flush=True)

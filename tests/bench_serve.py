"""`make bench`: what `serve` costs of a core in real time."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from benches.serve import Field
from serving import LOOPBACK

from omni_mj.live.serve.server import Server
from omni_mj.live.sockets import Address

PERIOD_S, SECONDS = 1 / 60, 8.0
CASES = ("1", "0", "rollers"), ("1", "0", "two-rollers"), ("6", "6", "two-rollers"), ("6", "6", "rollers")


def serve(blue: str, yellow: str, wheels: str) -> np.ndarray:
    """CPU time of each frame, s. A client commands all robots 60 times a second."""
    field = Field(f"wheels.model={wheels}", blue=blue, yellow=yellow)
    server = Server(field.pitch, (0, 0, 0), Address(LOOPBACK, 10020))
    script = Path(__file__).parent / "support" / "bench_client.py"
    client = subprocess.Popen([sys.executable, script, *map(str, server.ports[1:]), blue, yellow])
    used = list[float]()
    try:
        server.run(until_s=0.5)
        server.after_frame = lambda: used.append(time.process_time())
        server.run(until_s=0.5 + SECONDS)
        return np.diff(used)
    finally:
        client.kill()
        client.wait()
        server.close()


if __name__ == "__main__":
    print("serve in real time: CPU time of a frame, share of 1/60 s of a core")
    print("robots  wheels         10 %  50 %  90 %")
    for blue, yellow, wheels in CASES:
        used = serve(blue, yellow, wheels)
        shares = "".join(f"{np.quantile(used, q) / PERIOD_S:6.0%}" for q in (0.1, 0.5, 0.9))
        print(f"{int(blue) + int(yellow):6d}  {wheels:12s} {shares}", flush=True)

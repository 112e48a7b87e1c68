"""`make bench`: what `serve` costs of a core in real time."""

import math
import socket
import time
from multiprocessing import Process

import numpy as np
from benches.serve import Field
from serve_client import LOOPBACK, local

from omni_mj.live.serve.server import Server
from omni_mj.live.sockets import Address

PERIOD_S, SECONDS = 1 / 60, 8.0
CASES = ("1", "0"), ("6", "6")  # robots of both teams


def command_robots(ports: list[int], counts: tuple[int, int]) -> None:
    """Command all robots of both teams 60 times a second."""
    sender, tick, frame = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), time.monotonic(), 0
    while True:
        velocity = 0.4 * math.cos(frame / 60), 0.4 * math.sin(frame / 60)
        for port, count in zip(ports, counts, strict=True):
            sender.sendto(
                b"".join(local(i, *velocity, 0.5) for i in range(count)), (LOOPBACK, port)
            )
        frame, tick = frame + 1, tick + PERIOD_S
        time.sleep(max(tick - time.monotonic(), 0.0))


def serve(blue: str, yellow: str) -> np.ndarray:
    """CPU time of each frame, s. A client commands all robots 60 times a second."""
    field = Field("wheels.model=two-rollers", blue=blue, yellow=yellow)
    server = Server(field.pitch, (0, 0, 0), Address(LOOPBACK, 10020))
    client = Process(
        target=command_robots, args=(server.ports[1:], (int(blue), int(yellow))), daemon=True
    )
    client.start()
    used = list[float]()
    try:
        server.run(until_s=0.5)
        server.after_frame = lambda: used.append(time.process_time())
        server.run(until_s=0.5 + SECONDS)
        return np.diff(used)
    finally:
        client.kill()
        server.close()


if __name__ == "__main__":
    print("serve in real time: CPU time of a frame, share of 1/60 s of a core")
    print("robots   10 %  50 %  90 %")
    for blue, yellow in CASES:
        used = serve(blue, yellow)
        shares = "".join(f"{np.quantile(used, q) / PERIOD_S:6.0%}" for q in (0.1, 0.5, 0.9))
        print(f"{int(blue) + int(yellow):6d} {shares}", flush=True)

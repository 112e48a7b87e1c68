"""Commands all robots of both teams 60 times a second: `bench_client.py BLUE_PORT YELLOW_PORT BLUE YELLOW`."""

import math
import socket
import sys
import time

from serving import local

if __name__ == "__main__":
    ports, counts = sys.argv[1:3], sys.argv[3:5]
    sender, tick = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), time.monotonic()
    for frame in range(1_000_000):
        angle = frame / 60
        for port, count in zip(map(int, ports), map(int, counts), strict=True):
            packet = b"".join(local(i, 0.4 * math.cos(angle), 0.4 * math.sin(angle), 0.5) for i in range(count))
            if count:
                sender.sendto(packet, ("127.0.0.1", port))
        tick += 1 / 60
        time.sleep(max(tick - time.monotonic(), 0.0))

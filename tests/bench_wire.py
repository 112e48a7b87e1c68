"""What the wire format costs: a frame of 22 robots written and read, and 100 000 bad packets, as `make bench` runs it.

PYTHONPATH=tests/support python tests/bench_wire.py [packets]
"""

import sys
import time
import timeit

from wire_messages import bad_packets, full_frame

from omni_mj.live.wire import WireError, decode, encode
from omni_mj.live.wire.vision import VisionPacket

FRAME_S = 1 / 60
LIMIT_S = 1e-3  # to write and read a frame of 22 robots


def main() -> int:
    """Print what was measured; 1 if a frame took too long. Anything but a message or a `WireError` ends it."""
    frame = full_frame()
    packet = encode(frame)
    written = min(timeit.repeat(lambda: encode(frame), number=200, repeat=5)) / 200
    read = min(timeit.repeat(lambda: decode(VisionPacket, packet), number=200, repeat=5)) / 200
    share = (written + read) / FRAME_S
    print(f"22 robots, {len(packet)} bytes: written in {1e6 * written:.0f} us, read in {1e6 * read:.0f} us", end=", ")
    print(f"{share:.1%} of a frame of 1/60 s")

    count, refused, started = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000, 0, time.perf_counter()
    for bad in bad_packets(0, count):
        try:
            decode(VisionPacket, bad)
        except WireError:
            refused += 1
    print(f"{count} bad packets in {time.perf_counter() - started:.1f} s: {refused} refused, the others read")
    return int(written + read > LIMIT_S)


if __name__ == "__main__":
    sys.exit(main())

"""The wire format of SSL-Vision and ssl-simulation-protocol, by tables and a codec of our own.

`decode(VisionPacket, datagram)` is a message, or raises `WireError`; `encode(RobotControl(...))` is a datagram. The
messages are in `vision` and `simulation`.
"""

from omni_mj.live.wire.format import decode, encode
from omni_mj.live.wire.kinds import WireError

__all__ = ["WireError", "decode", "encode"]

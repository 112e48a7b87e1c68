"""The server's ports: datagrams that are answered, and TCP streams of the protocol's synchronous mode."""

import io
import socket
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

from google.protobuf import proto
from google.protobuf.message import Message

from omni_control.errors import OmniError
from omni_mj.live.sockets import LOOPBACK, MAX_DATAGRAM, Address, Receiver, reason
from omni_mj.live.wire import WireError, parse
from omni_mj.live.wire.simulation_pb2 import SyncRequest

BURST = 64  # datagrams read from one port before the others have their turn
TIMEOUT_S = 1.0  # for a client of the synchronous mode that stops in the middle of a message


class Ports(NamedTuple):
    """Addresses of the server.

    Args:
        control_port, blue_port, yellow_port: Ports; 0 takes a free one.
        vision: Where detections go.
        interface: Address of the network interface; loopback keeps everything on this computer.
    """

    control_port: int
    blue_port: int
    yellow_port: int
    vision: Address
    interface: str = LOOPBACK


class Port(Receiver):
    """A UDP port that answers.

    Args:
        where: As of `Receiver`.
        interface: As of `Receiver`.
        team: Whose commands come there; None for those to the simulator.
    """

    def __init__(self, where: Address, interface: str, team: int | None) -> None:
        super().__init__(where, interface)
        self.team = team

    def requests(self) -> Iterator[tuple[bytes, Address]]:
        """Return datagrams and their senders."""
        return ((data, sender) for data, _, sender in islice(self.packets(), BURST))

    def reply(self, data: bytes, to: Address) -> None:
        """Send an answer."""
        self._socket.sendto(data, to)


def listen(address: Address) -> socket.socket:
    """Return a socket that accepts TCP connections.

    Raises:
        OmniError: The port is taken.
    """
    try:
        return socket.create_server(address)
    except OSError as error:
        raise OmniError(f"cannot listen to {address} by TCP: {reason(error)}") from None


class Stream:
    """A client of the synchronous mode. Each message follows its length as a varint.

    Args:
        connection: Its socket.
        team: As of `Port`.
    """

    def __init__(self, connection: socket.socket, team: int | None) -> None:
        self.socket, self.team, self.address = connection, team, Address(*connection.getpeername())
        connection.settimeout(TIMEOUT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._input = connection.makefile("rb", 1)  # reads nothing ahead, which `select` would not know of

    def fileno(self) -> int:
        """Return the descriptor for `selectors`."""
        return self.socket.fileno()

    def receive(self) -> SyncRequest:
        """Wait for a message.

        Raises:
            WireError: It is malformed or too long.
            OSError: The client has gone, or stopped in the middle.
        """
        size = shift = 0
        while True:
            byte = self._input.read(1)
            if not byte:
                raise ConnectionResetError
            size |= (byte[0] & 0x7F) << shift
            shift += 7
            if size > MAX_DATAGRAM or shift > 35:
                raise WireError(f"a message is longer than {MAX_DATAGRAM} bytes")
            if byte[0] < 0x80:
                return parse(SyncRequest, self._input.read(size))

    def reply(self, message: Message) -> None:
        """Send an answer."""
        packet = io.BytesIO()
        proto.serialize_length_prefixed(message, packet)
        self.socket.sendall(packet.getvalue())

    def close(self) -> None:
        """Hang up."""
        self._input.close()
        self.socket.close()

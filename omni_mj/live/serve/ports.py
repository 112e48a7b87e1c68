"""Where `serve` is spoken to: packets that are answered, and streams of the protocol's synchronous mode."""

import socket
import sys
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

from omni_control.errors import OmniError
from omni_mj.live.sockets import LOOPBACK, MOST_BYTES, Address, Receiver, why
from omni_mj.live.wire import WireError
from omni_mj.live.wire.kinds import MOST_OF_32_BITS, read_varint, write_varint
from omni_mj.live.wire.simulation import BLUE_PORT, SIMULATOR_PORT, YELLOW_PORT, Team
from omni_mj.live.wire.vision import SIMULATED_VISION_PORT, VISION_GROUP

AT_ONCE = 64  # packets read from a socket before the others have their turn
PATIENCE_S = 1.0  # for a client that does not read what it is answered


class Ports(NamedTuple):
    """Where is listened and sent.

    Args:
        control, blue, yellow: ports; 0 takes a free one.
        vision: where detections go.
        interface: by which; loopback keeps all on this computer.
    """

    control: int = SIMULATOR_PORT
    blue: int = BLUE_PORT
    yellow: int = YELLOW_PORT
    vision: Address = Address(VISION_GROUP, SIMULATED_VISION_PORT)
    interface: str = LOOPBACK


class Port(Receiver):
    """A port of UDP that answers.

    Args:
        where: as of `Receiver`.
        interface: same.
        team: whose commands come there; None for those to the simulator.
    """

    def __init__(self, where: Address, interface: str, team: Team | None) -> None:
        super().__init__(where, interface)
        self.team = team

    def requests(self) -> Iterator[tuple[bytes, Address]]:
        """What came, and from whom."""
        return ((data, source) for data, _, source in islice(self.packets(), AT_ONCE))

    def reply(self, data: bytes, to: Address) -> None:
        """Send from here to whoever asked."""
        self._socket.sendto(data, to)

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()


class Listener:
    """The same port of TCP, whose clients each have a stream.

    Args:
        port: of UDP.

    Raises:
        OmniError: it is taken.
    """

    def __init__(self, port: Port) -> None:
        self.team, self._socket = port.team, socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if sys.platform != "win32":  # else it is taken for a minute after the end
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind(port.address)
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise OmniError(f"cannot listen to {port.address} by TCP: {why(error)}") from None

    def accept(self) -> "Stream":
        """The client that has come."""
        return Stream(self._socket.accept()[0], self.team)

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    def close(self) -> None:
        """Free the port."""
        self._socket.close()


class Stream:
    """A client of the synchronous mode: messages, each after its length as a varint, as with the game controller.

    Args:
        made: its socket.
        team: as of `Port`.
    """

    def __init__(self, made: socket.socket, team: Team | None) -> None:
        self.team, self._socket, self._unread = team, made, b""
        self.address = Address(*made.getpeername())
        made.settimeout(PATIENCE_S)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def requests(self) -> Iterator[bytes]:
        """What came whole.

        Raises:
            WireError: a message is longer than any can be.
            OSError: the client has gone.
        """
        came = self._socket.recv(MOST_BYTES)
        if not came:
            raise ConnectionResetError
        self._unread += came
        while (size := self._size()) is not None:
            length, begins = size
            if len(self._unread) < begins + length:
                return
            message = self._unread[begins : begins + length]
            self._unread = self._unread[begins + length :]
            yield message

    def _size(self) -> tuple[int, int] | None:
        """The next message's length, and where it begins; None if that has not come whole."""
        head = self._unread[:MOST_OF_32_BITS]
        if len(head) < MOST_OF_32_BITS and all(byte > 0x7F for byte in head):
            return None
        length, begins = read_varint(head, 0, len(head), MOST_OF_32_BITS)
        if length > MOST_BYTES:
            raise WireError(f"a message of {length} bytes; it has {MOST_BYTES} at most")
        return length, begins

    def reply(self, data: bytes) -> None:
        """Answer."""
        self._socket.sendall(write_varint(len(data)) + data)

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

"""UDP and TCP as the league uses them: vision from a multicast group or to an address, commands to a host.

Everything is bound and sent to this computer alone, with a time to live of 0, unless an interface is named.
"""

import io
import ipaddress
import os
import select
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

from google.protobuf import proto
from google.protobuf.message import DecodeError, Message

from omni_control.errors import OmniError
from omni_mj.live.wire import MessageT, WireError, check_complete

LOOPBACK = "127.0.0.1"
MAX_DATAGRAM = 65_536  # bytes
CLIENT_TIMEOUT_S = 1.0  # for a TCP client that stops in the middle of a message
BUFFER_BYTES = 1 << 21  # of the kernel: some seconds of four cameras


class Notes(Counter[str]):
    """Counts of packets and of what went wrong with them, by kind.

    Args:
        tell: Called with the first message of each kind.
    """

    def __init__(self, tell: Callable[[str], None] = lambda text: None) -> None:
        super().__init__()
        self._tell = tell

    def add(self, kind: str, text: str) -> None:
        """Count an event, and tell it if it is the first of its kind."""
        self[kind] += 1
        if self[kind] == 1:
            self._tell(text)


class Address(NamedTuple):
    """An IPv4 address and a port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def address(text: str, default_port: int, interface: str = "") -> Address:
    """Parse HOST:PORT, or HOST alone.

    Args:
        text: What is parsed.
        default_port: Port of a host alone.
        interface: Address of the network interface by which packets leave for the host, if they do.

    Raises:
        OmniError: The text is no address, the host is unknown, or it is another computer and no interface is named.
    """
    host, colon, port = text.strip().partition(":")
    port = port if colon else str(default_port)
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise OmniError(f"{text!r} is no address: write HOST:PORT, such as 127.0.0.1:10020, ports from 1 to 65535")
    try:
        number = ipaddress.ip_address(socket.gethostbyname(host))
    except (OSError, UnicodeError):
        raise OmniError(f"nobody knows the host {host!r}; give an IPv4 address, such as 127.0.0.1") from None
    if interface == LOOPBACK and not (number.is_loopback or number.is_multicast):
        raise OmniError(
            f"{host} is another computer, and packets stay on this one: name the interface that leads there,"
            " by its address, with --interface"
        )
    return Address(str(number), int(port))


def sender(interface: str = LOOPBACK) -> socket.socket:
    """Return a socket that sends by an interface; by loopback to this computer alone.

    Raises:
        OmniError: There is no such interface.
    """
    connection = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        connection.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
        connection.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(interface != LOOPBACK))
        connection.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        connection.bind((interface, 0))
        connection.setblocking(False)
    except OSError as error:
        connection.close()
        raise OmniError(f"cannot send by the interface {interface!r}: {reason(error)}") from None
    return connection


class Receiver(socket.socket):
    """Receives datagrams that come to an address: of a multicast group, which is joined, or of this computer.

    Args:
        where: The group or address, and the port; port 0 takes a free one.
        interface: Address of the network interface.

    Attributes:
        address: Where it receives.

    Raises:
        OmniError: The address is taken, or there is no such interface.
    """

    def __init__(self, where: Address, interface: str = LOOPBACK) -> None:
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            if ipaddress.ip_address(where.host).is_multicast:
                self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # many listen to one group
                self.bind(where)
                member = socket.inet_aton(where.host) + socket.inet_aton(interface)
                self.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            else:
                self.bind(where)
            self.setblocking(False)
        except OSError as error:
            self.close()
            raise OmniError(f"cannot listen to {where} by the interface {interface!r}: {reason(error)}") from None
        self.address = Address(*self.getsockname())

    def wait(self, until: float) -> bool:
        """Return whether something comes before `until` (`time.monotonic`)."""
        return bool(select.select([self], [], [], max(until - time.monotonic(), 0.0))[0])

    def packets(self) -> Iterator[tuple[bytes, float, Address]]:
        """Yield what has come: bytes, time of reading (`time.monotonic`), sender."""
        while True:
            try:
                data, source = self.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:  # such as that nobody listens where something was sent before
                continue
            yield data, time.monotonic(), Address(*source)


def listen(where: Address) -> socket.socket:
    """Return a socket that accepts TCP connections.

    Raises:
        OmniError: The port is taken.
    """
    try:
        return socket.create_server(where)
    except OSError as error:
        raise OmniError(f"cannot listen to {where} by TCP: {reason(error)}") from None


class Stream:
    """A TCP connection. Each message follows its length as a varint.

    Args:
        connection: Its socket.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._socket, self.address = connection, Address(*connection.getpeername())
        connection.settimeout(CLIENT_TIMEOUT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._input = connection.makefile("rb", 1)  # reads nothing ahead, which `select` would not know of

    def fileno(self) -> int:
        """Return the descriptor for `selectors`."""
        return self._socket.fileno()

    def read(self, size: int) -> bytes:
        """Return `size` bytes, for protobuf's parser."""
        if size > MAX_DATAGRAM:
            raise WireError(f"a message is longer than {MAX_DATAGRAM} bytes")
        return self._input.read(size)

    def receive(self, message_type: type[MessageT]) -> MessageT:
        """Wait for a message.

        Raises:
            WireError: It is malformed or too long.
            OSError: The client has gone, or stopped in the middle.
        """
        try:
            message = proto.parse_length_prefixed(message_type, self)
        except (DecodeError, ValueError) as error:
            raise WireError(str(error)) from None
        if message is None:
            raise ConnectionResetError
        return check_complete(message)

    def reply(self, message: Message) -> None:
        """Send an answer."""
        packet = io.BytesIO()
        proto.serialize_length_prefixed(message, packet)
        self._socket.sendall(packet.getvalue())

    def close(self) -> None:
        """Hang up."""
        self._input.close()
        self._socket.close()


def reason(error: OSError) -> str:
    """Return what the system says of an error, in lower case."""
    code = error.errno or 0  # negative if a host is unknown
    # `socket.create_server` adds an address to `strerror`.
    return (os.strerror(code) if code > 0 else error.strerror or str(error)).lower()

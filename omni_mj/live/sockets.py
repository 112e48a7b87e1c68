"""UDP as the league uses it: vision from a multicast group or to an address, commands to a host.

Everything is bound and sent to this computer alone, with a time to live of 0, unless an interface is named.
"""

import ipaddress
import select
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

from omni_control.errors import OmniError

LOOPBACK = "127.0.0.1"
MAX_DATAGRAM = 65_536  # bytes
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
        OmniError: The text is no address, the host is unknown, or it is another computer and no
            interface is named.
    """
    host, colon, port = text.strip().partition(":")
    port = port if colon else str(default_port)
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise OmniError(
            f"{text!r} is no address: write HOST:PORT, such as 127.0.0.1:10020, ports from 1 to 65535"
        )
    try:
        number = ipaddress.ip_address(socket.gethostbyname(host))
    except (OSError, UnicodeError):
        raise OmniError(
            f"nobody knows the host {host!r}; give an IPv4 address, such as 127.0.0.1"
        ) from None
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
        connection.setsockopt(
            socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface)
        )
        connection.setsockopt(
            socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(interface != LOOPBACK)
        )
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
                self.setsockopt(
                    socket.SOL_SOCKET, socket.SO_REUSEADDR, 1
                )  # many listen to one group
                self.bind(where)
                member = socket.inet_aton(where.host) + socket.inet_aton(interface)
                self.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            else:
                self.bind(where)
            self.setblocking(False)
        except OSError as error:
            self.close()
            raise OmniError(
                f"cannot listen to {where} by the interface {interface!r}: {reason(error)}"
            ) from None
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


def reason(error: OSError) -> str:
    """Return what the system says of an error, in lower case."""
    return (error.strerror or str(error)).lower()

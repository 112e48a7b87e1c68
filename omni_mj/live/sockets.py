"""UDP as the league uses it: vision from a multicast group or to an address, commands to a host.

Everything is bound and sent to this computer alone, with a time to live of 0, unless an interface is named.
"""

import ipaddress
import select
import socket
import time
from collections.abc import Iterator
from typing import NamedTuple

from omni_control.errors import OmniError

LOOPBACK = "127.0.0.1"
MAX_DATAGRAM = 65_536  # bytes
BUFFER_BYTES = 1 << 21  # of the kernel: some seconds of four cameras


class Address(NamedTuple):
    """An IPv4 address and a port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def address(text: str, default_port: int) -> Address:
    """Parse HOST:PORT, or HOST alone.

    Raises:
        OmniError: The text is no address, or the host is unknown.
    """
    host, colon, port = text.strip().partition(":")
    port = port if colon else str(default_port)
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise OmniError(f"{text!r} is no address: write HOST:PORT, such as 127.0.0.1:10020, ports from 1 to 65535")
    try:
        return Address(socket.gethostbyname(host), int(port))
    except (OSError, UnicodeError):
        raise OmniError(f"nobody knows the host {host!r}; give an IPv4 address, such as 127.0.0.1") from None


def check_local(target: Address, interface: str) -> None:
    """Check that nothing is sent beyond this computer unless an interface is named.

    Raises:
        OmniError: It would be.
    """
    host = ipaddress.ip_address(target.host)
    if interface == LOOPBACK and not (host.is_loopback or host.is_multicast):
        raise OmniError(
            f"{target.host} is another computer, and packets stay on this one: name the interface that leads there,"
            " by its address, with --interface"
        )


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


class Receiver:
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
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            if ipaddress.ip_address(where.host).is_multicast:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # many listen to one group
                self._socket.bind(where)
                member = socket.inet_aton(where.host) + socket.inet_aton(interface)
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            else:
                self._socket.bind(where)
            self._socket.setblocking(False)
        except OSError as error:
            self._socket.close()
            raise OmniError(f"cannot listen to {where} by the interface {interface!r}: {reason(error)}") from None
        self.address = Address(*self._socket.getsockname())

    def fileno(self) -> int:
        """Return the descriptor for `select` and `selectors`."""
        return self._socket.fileno()

    def wait(self, until: float) -> bool:
        """Return whether something comes before `until` (`time.monotonic`)."""
        return bool(select.select([self], [], [], max(until - time.monotonic(), 0.0))[0])

    def packets(self) -> Iterator[tuple[bytes, float, Address]]:
        """Yield what has come: bytes, time of reading (`time.monotonic`), sender."""
        while True:
            try:
                data, source = self._socket.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:  # such as that nobody listens where something was sent before
                continue
            yield data, time.monotonic(), Address(*source)

    def close(self) -> None:
        """Free the address."""
        self._socket.close()


def reason(error: OSError) -> str:
    """Return what the system says of an error, in lower case."""
    return (error.strerror or str(error)).lower()

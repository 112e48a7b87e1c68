"""UDP as the league uses it: vision from a multicast group or to an address, commands to a host.

All is bound and sent to this computer alone, with a time to live of 0, unless an interface is named.
"""

import ipaddress
import select
import socket
import struct
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

from omni_control.errors import OmniError

LOOPBACK = "127.0.0.1"
MOST_BYTES = 65_536
ROOM_BYTES = 1 << 21  # of the kernel's buffer: some seconds of four cameras


class Address(NamedTuple):
    """Where packets are sent, or received: an IPv4 address and a port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def address(text: str, port: int | None = None) -> Address:
    """An address written as HOST:PORT, or HOST alone where there is a usual port.

    Raises:
        OmniError: it is none, or a name that nobody knows.
    """
    host, colon, number = text.strip().partition(":")
    number = number if colon else "" if port is None else str(port)
    if not host or not number.isdecimal() or not 0 < int(number) < 65_536:
        raise OmniError(f"{text!r} is no address: write HOST:PORT, such as 127.0.0.1:10020, ports from 1 to 65535")
    try:
        return Address(socket.gethostbyname(host), int(number))
    except (OSError, UnicodeError):
        raise OmniError(f"nobody knows the host {host!r}; give an IPv4 address, such as 127.0.0.1") from None


def check_local(target: Address, interface: str) -> None:
    """See that nothing is sent beyond this computer unless an interface is named.

    Raises:
        OmniError: it would be.
    """
    host = ipaddress.ip_address(target.host)
    if interface == LOOPBACK and not (host.is_loopback or host.is_multicast):
        raise OmniError(
            f"{target.host} is another computer, and packets stay on this one: name the interface that leads there,"
            " by its address, with --interface"
        )


def sender(interface: str = LOOPBACK) -> socket.socket:
    """A socket to send from, by an interface: to this computer alone, unless another one than loopback is named.

    Raises:
        OmniError: there is no such interface.
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    reach = 0 if interface == LOOPBACK else 1
    try:
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, reach)
        made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        made.bind((interface, 0))
        made.setblocking(False)
    except OSError as error:
        made.close()
        raise OmniError(f"cannot send by the interface {interface!r}: {why(error)}") from None
    return made


class Receiver:
    """Datagrams that come to an address: of a multicast group, which is joined, or of this computer.

    Args:
        where: the group or address, and the port; port 0 takes a free one.
        interface: by which they come.

    Raises:
        OmniError: the address is taken, or there is no such interface.
    """

    def __init__(self, where: Address, interface: str = LOOPBACK) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        group = ipaddress.ip_address(where.host).is_multicast
        try:
            if group:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # many listen to one group
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, ROOM_BYTES)
            self._socket.bind(("" if group and sys.platform == "win32" else where.host, where.port))
            if group:
                member = struct.pack("4s4s", socket.inet_aton(where.host), socket.inet_aton(interface))
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            self._socket.setblocking(False)
        except OSError as error:
            self._socket.close()
            raise OmniError(f"cannot listen to {where} by the interface {interface!r}: {why(error)}") from None
        self.address = Address(*self._socket.getsockname())

    def wait(self, until: float) -> bool:
        """Whether something came before our clock (`time.monotonic`) says `until`; what is there counts at once."""
        ready, _, _ = select.select([self._socket], [], [], max(until - time.monotonic(), 0.0))
        return bool(ready)

    def packets(self) -> Iterator[tuple[bytes, float, Address]]:
        """What is there: bytes, when they were read (`time.monotonic`), and from whom; it waits for nothing."""
        while True:
            try:
                data, source = self._socket.recvfrom(MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:  # such as that nobody listens where something was sent before
                continue
            yield data, time.monotonic(), Address(*source)

    def close(self) -> None:
        """Free the address."""
        self._socket.close()


def why(error: OSError) -> str:
    """What the system says of an error, in lower case."""
    return (error.strerror or str(error)).lower()

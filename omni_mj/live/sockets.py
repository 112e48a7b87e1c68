"""UDP sockets for vision (multicast or unicast) and commands (unicast).

By default all packets stay on this computer (loopback, time to live 0).
"""

import ipaddress
import select
import socket
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import NamedTuple

from omni_control.errors import OmniError, to_printable

LOOPBACK = "127.0.0.1"
MAX_DATAGRAM = 65_536  # bytes
MAX_READS = 1000  # datagrams that are read at a time
MAX_KINDS = 100  # of messages
BUFFER_BYTES = 1 << 21  # receive buffer of the kernel: some seconds of four cameras


class MessageCounter(Counter[str]):
    """Counts of packets and problems, by kind.

    Args:
        on_first: Called with the first message of each kind and topic.
    """

    def __init__(self, on_first: Callable[[str], None] = lambda text: None) -> None:
        super().__init__()
        self._on_first = on_first
        self._reported = set[tuple[str, str]]()

    def add(self, kind: str, text: str, topic: str = "") -> None:
        """Count a message, and report its text if it is the first of its kind and topic."""
        if kind not in self and len(self) >= MAX_KINDS:
            kind, topic = "other messages", ""
        self[kind] += 1
        if (kind, topic) not in self._reported and len(self._reported) <= MAX_KINDS:
            self._reported.add((kind, topic))
            self._on_first(to_printable(text))


class Address(NamedTuple):
    """An IPv4 address and a port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def parse_address(text: str, default_port: int, interface: str = "") -> Address:
    """Parse HOST:PORT, or HOST alone.

    Args:
        text: Text to parse.
        default_port: Port if the text has none.
        interface: Address of the network interface that sends packets to the host, if any.

    Raises:
        OmniError: The text is malformed, the host is unknown, or it is another computer although
            packets leave by the loopback interface.
    """
    host, colon, port = text.strip().partition(":")
    port = port if colon else str(default_port)
    if not host or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise OmniError(
            f"{text!r} is not an address; write HOST:PORT with a port from 1 to 65535, such as"
            " 127.0.0.1:10020"
        )
    try:
        number = ipaddress.ip_address(socket.gethostbyname(host))
    except (OSError, UnicodeError):
        raise OmniError(f"unknown host {host!r}; give an IPv4 address, such as 127.0.0.1") from None
    if interface == LOOPBACK and not (number.is_loopback or number.is_multicast):
        raise OmniError(
            f"{host} is another computer, but packets leave by the loopback interface;"
            " give the address of the network interface with --interface"
        )
    return Address(str(number), int(port))


def open_sender(interface: str) -> socket.socket:
    """Return a socket that sends by an interface. By loopback, packets stay on this computer.

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
        raise OmniError(
            f"cannot send on the interface {interface!r}: {error_reason(error)}"
        ) from None
    return connection


class Receiver(socket.socket):
    """Socket that receives datagrams for a multicast group or for this computer.

    Args:
        target: Multicast group to join, or address of this computer, and port. Port 0: any free
            port.
        interface: Address of the network interface.
        sender: The only sender whose packets are received; see `open_branch`. Default: any.

    Attributes:
        address: Address and port of the socket.

    Raises:
        OmniError: The address is taken, or there is no such interface.
    """

    def __init__(self, target: Address, interface: str, sender: Address | None = None) -> None:
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if sender:
                self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                self.bind(target)
                self.connect(sender)
                self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
            elif ipaddress.ip_address(target.host).is_multicast:
                # Several programs may listen to one group.
                self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                self.bind(target)
                member = socket.inet_aton(target.host) + socket.inet_aton(interface)
                self.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            else:
                self.bind(target)
            if not sender:
                self.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            self.setblocking(False)
        except OSError as error:
            self.close()
            raise OmniError(
                f"cannot listen to {target} on the interface {interface!r}: {error_reason(error)}"
            ) from None
        self.address = Address(*self.getsockname())

    def open_branch(self, sender: Address) -> "Receiver | None":
        """Return a socket for later packets of a sender, so that no other sender fills its queue.

        Returns:
            None if the operating system has no such sockets, or no more of them.
        """
        if sys.platform != "linux":
            return None
        # Only while the branch is bound: other programs must find the port in use.
        self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            return Receiver(self.address, self.address.host, sender)
        except OmniError:
            return None
        finally:
            self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)

    def wait(self, until: float) -> bool:
        """Return whether a packet arrives before `until` (`time.monotonic`)."""
        return bool(select.select([self], [], [], max(until - time.monotonic(), 0.0))[0])

    def packets(self) -> Iterator[tuple[bytes, float, Address]]:
        """Yield packets that have arrived: bytes, arrival (`time.monotonic`), sender."""
        for _ in range(MAX_READS):
            try:
                data, source = self.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:  # for example an ICMP error after an earlier send
                continue
            yield data, time.monotonic(), Address(*source)


def error_reason(error: OSError) -> str:
    """Return the operating system's description of an error, in lower case."""
    return (error.strerror or str(error)).lower()

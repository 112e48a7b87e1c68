"""Packets of the clients of `serve`: bounded queues, which are handled in turn."""

import selectors
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from omni_mj.live.sockets import Address, MessageCounter, Receiver

MAX_CLIENTS = 100  # a client that was silent for some time makes room for another
SILENT_S, KNOWN_SILENT_S = 0.25, 5.0  # after its first packet, after later ones
MAX_QUEUE = 32  # packets of a client that wait; older ones are dropped
FULL_S = 0.01  # time until new clients are considered again if all places are taken
TOO_MANY = "packets of too many clients"
# Packets of a socket, and time for those of all, before the simulation goes on, although it is late
MAX_READS, READ_S = 100, 0.001
MAX_BYTES = 16_384  # of a packet; those of all robots have less than 2,000


class Request(NamedTuple):
    """A packet.

    Attributes:
        team: Team whose port received it, None for the simulator's port.
        client: Address of the sender.
        data: Bytes.
    """

    team: int | None
    client: Address
    data: bytes


@dataclass(eq=False)
class _Client:
    """A client whose packets are accepted.

    Attributes:
        expiry: Time from which on it counts as silent, s.
        queue: Its waiting packets.
        branch: Its own socket, if it has one.
    """

    expiry: float
    queue: deque[Request] = field(default_factory=deque)
    branch: Receiver | None = None


class Inbox:
    """Queues of packets, one for each client, so that no client delays another.

    A client that sent twice gets a socket of its own, whose queue a flood by others cannot fill.

    Args:
        ports: Team, or None for the simulator -> socket. The caller closes the sockets.
        messages: Counts packets that are dropped.
    """

    def __init__(self, ports: Mapping[int | None, Receiver], messages: MessageCounter) -> None:
        self._ports, self._messages = ports, messages
        self._clients = dict[tuple[int | None, Address], _Client]()
        self._full_until = 0.0  # until then, new clients are refused
        self._turns = deque[_Client]()  # clients with waiting packets
        self._is_turn_of_oldest = False
        self._selector = selectors.DefaultSelector()
        for team, port in ports.items():
            self._selector.register(port, selectors.EVENT_READ, (port, team))

    def close(self) -> None:
        """Free the selector and the clients' sockets."""
        self._selector.close()
        for client in self._clients.values():
            if client.branch:
                client.branch.close()

    def receive(self, seconds: float) -> None:
        """Queue the packets that have arrived; if none waits, wait for one for some seconds.

        Sockets are read in turn. A flood of packets takes hardly longer. The rest is read the next
        time.
        """
        ready = self._selector.select(0.0 if self._turns else max(seconds, 0.0))
        until = time.monotonic() + READ_S
        for _ in range(MAX_READS):
            ready = [source for source in ready if self._read(*source[0].data)]
            if not ready or time.monotonic() > until:
                break

    def take(self) -> Request | None:
        """Return the oldest packet of the client whose turn it is, or None if none waits.

        Every second turn is that of the client that is known for longest, so that a flood by many
        new clients delays it by one packet.
        """
        if not self._turns:
            return None
        self._is_turn_of_oldest = not self._is_turn_of_oldest
        client = self._turns[0]
        if self._is_turn_of_oldest:
            client = next(client for client in self._clients.values() if client.queue)
        self._turns.remove(client)
        request = client.queue.popleft()
        if client.queue:
            self._turns.append(client)
        return request

    def _read(self, port: Receiver, team: int | None) -> bool:
        """Queue a packet of a socket, and return whether there was one."""
        packet = None if port.fileno() < 0 else next(port.packets(), None)
        if packet is None:
            return False
        data, arrival, client = packet
        self._add(Request(team, client, data), arrival)
        return True

    def _add(self, request: Request, arrival: float) -> None:
        """Queue a packet, and count it if it is dropped."""
        key = request.team, request.client
        if len(request.data) > MAX_BYTES:
            self._messages.add(
                "bad packets",
                f"skipped a packet from {request.client}: {len(request.data)} bytes, of at most"
                f" {MAX_BYTES}",
            )
            return
        client = self._clients.get(key)
        if client is None:
            if arrival < self._full_until:  # a flood costs little
                self._messages[TOO_MANY] += 1
                return
            if not self._make_room(arrival):
                self._full_until = arrival + FULL_S
                self._messages.add(
                    TOO_MANY,
                    f"skipped a packet from {request.client}: {MAX_CLIENTS} others are served",
                )
                return
            client = self._clients[key] = _Client(arrival + SILENT_S)
        else:
            client.expiry = arrival + KNOWN_SILENT_S
            if not client.branch and (
                branch := self._ports[request.team].open_branch(request.client)
            ):
                client.branch = branch
                self._selector.register(branch, selectors.EVENT_READ, (branch, request.team))
        if not client.queue:
            self._turns.append(client)
        elif len(client.queue) == MAX_QUEUE:
            client.queue.popleft()
            self._messages.add(
                "packets too fast",
                f"{request.client} sends faster than its packets can be handled; older packets"
                " are dropped",
            )
        client.queue.append(request)

    def _make_room(self, arrival: float) -> bool:
        """Forget a client that is silent if all places are taken, and return whether one is."""
        if len(self._clients) == MAX_CLIENTS:
            key, client = min(self._clients.items(), key=lambda item: item[1].expiry)
            if client.queue or arrival < client.expiry:
                return False
            del self._clients[key]
            if client.branch:
                self._selector.unregister(client.branch)
                client.branch.close()
        return True

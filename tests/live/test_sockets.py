"""Sockets: to this computer alone unless an interface is named."""

import socket
import time

import pytest

from omni_control.errors import OmniError
from omni_mj.live import sockets
from omni_mj.live.sockets import LOOPBACK, Address, Receiver


def test_a_group_reaches_this_computer_with_a_time_to_live_of_zero() -> None:
    receiver = Receiver(Address("224.5.23.2", 0))
    another = Receiver(Address("224.5.23.2", receiver.address.port))
    sender = sockets.sender()
    try:
        assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        assert sender.getsockname()[0] == LOOPBACK
        sender.sendto(b"hello", ("224.5.23.2", receiver.address.port))
        for each in (receiver, another):
            assert each.wait(time.monotonic() + 5)
            ((data, arrival, source),) = each.packets()
            assert (data, source.host) == (b"hello", LOOPBACK)
            assert arrival <= time.monotonic()
            assert not each.wait(time.monotonic())
    finally:
        for each in (receiver, another, sender):
            each.close()


def test_an_address_may_be_taken_once() -> None:
    receiver = Receiver(Address(LOOPBACK, 0))
    with pytest.raises(OmniError, match=f"cannot listen to {receiver.address}.*in use"):
        Receiver(receiver.address)
    receiver.close()


@pytest.mark.parametrize("interface", ["8.8.8.8", "nonsense", ""])
def test_an_interface_that_is_not_there_is_named(interface: str) -> None:
    with pytest.raises(OmniError, match="by the interface"):
        sockets.sender(interface)
    with pytest.raises(OmniError, match="by the interface"):
        Receiver(Address("224.5.23.2", 0), interface)


@pytest.mark.parametrize(
    "text", ["", ":1", "127.0.0.1:", "127.0.0.1:0", "127.0.0.1:65536", "127.0.0.1:x", "::1", "a b:1"]
)
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(OmniError, match=r"no address|nobody knows"):
        sockets.address(text)


def test_addresses() -> None:
    assert sockets.address("127.0.0.1:10301") == Address(LOOPBACK, 10301)
    assert sockets.address("localhost", 7) == Address(LOOPBACK, 7)


def test_nothing_leaves_this_computer_unasked() -> None:
    sockets.check_local(Address("127.0.0.1", 1), LOOPBACK)
    sockets.check_local(Address("192.0.2.1", 1), "192.0.2.9")
    with pytest.raises(OmniError, match="--interface"):
        sockets.check_local(Address("192.0.2.1", 1), LOOPBACK)

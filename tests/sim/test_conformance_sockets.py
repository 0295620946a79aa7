"""The address of a system id on a UDP port: a vehicle may move, and a second one with its id is ignored."""

from sim_vehicle.conformance.sockets import SenderAddresses

A, B = ("127.0.0.1", 1), ("127.0.0.1", 2)


def test_a_silent_vehicle_may_return_at_another_address() -> None:
    senders = SenderAddresses()
    assert senders.received(1, A, 0.0)
    assert senders.received(1, B, 1.5)
    assert senders.address(1) == B
    assert senders.addresses == [B]


def test_a_second_vehicle_with_the_same_id_is_ignored() -> None:
    senders = SenderAddresses()
    assert senders.received(1, A, 0.0)
    assert not senders.received(1, B, 0.4)
    assert senders.received(1, A, 0.8)
    assert senders.is_ambiguous(1)
    assert senders.address(1) == A
    assert not senders.received(1, B, 60.0)  # not even when the first has fallen silent
    assert senders.received(1, A, 61.0)


def test_a_vehicle_may_return_at_another_address_after_a_quick_reboot() -> None:
    senders = SenderAddresses()
    assert senders.received(1, A, 0.0)
    assert not senders.received(1, B, 0.5)
    assert senders.received(1, B, 1.5)
    assert senders.address(1) == B
    assert not senders.is_ambiguous(1)


def test_systems_behind_one_address_are_listed_once() -> None:
    senders = SenderAddresses()
    assert senders.received(1, A, 0.0)
    assert senders.received(2, A, 0.0)
    assert senders.received(3, B, 0.0)
    assert senders.addresses == [A, B]
    assert senders.address(9) is None

"""Who speaks for a system id on a port: a vehicle that moved does, a second one with its id never."""

from sim_vehicle.conformance.senders import Senders

A, B = ("127.0.0.1", 1), ("127.0.0.1", 2)


def test_a_vehicle_that_was_silent_may_come_back_elsewhere() -> None:
    senders = Senders()
    assert senders.heard(1, A, 0.0)
    assert senders.heard(1, B, 1.5)
    assert senders.address(1) == B
    assert senders.addresses == [B]


def test_a_second_vehicle_with_its_id_is_not_heard_and_never_gets_what_was_meant_for_it() -> None:
    senders = Senders()
    assert senders.heard(1, A, 0.0)
    assert not senders.heard(1, B, 0.4)
    assert senders.address(1) == A
    assert not senders.heard(1, B, 60.0)  # not even when the first has fallen silent
    assert senders.heard(1, A, 61.0)


def test_systems_behind_one_address_are_one_place_to_send_to() -> None:
    senders = Senders()
    assert senders.heard(1, A, 0.0)
    assert senders.heard(2, A, 0.0)
    assert senders.heard(3, B, 0.0)
    assert senders.addresses == [A, B]
    assert senders.address(9) is None

"""The conformance suite is safe for its vehicle: dangerous checks, reboots, restoration, links."""

import contextlib
import socket
import threading
from typing import Any

import pytest
from bent_vehicle import (
    BentWire,
    DroppingWire,
    FleetWire,
    acknowledged,
    conform,
    connected,
    fleet,
    has_mission,
    named,
    one_check,
    selects,
    store_mission,
    without_simulator_mark,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, parameters
from sim_vehicle.conformance.guard import ALTER, ARM, CRASH, REBOOT
from sim_vehicle.conformance.link_wire import LinkWire, SenderAddresses
from sim_vehicle.conformance.outcomes import Outcome, Skip
from sim_vehicle.conformance.registry import all_checks, select
from sim_vehicle.conformance.runner import granted_permissions, run
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.links.url import parse_url
from sim_vehicle.station.messages import heartbeat

REQUEST, INTERVAL = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
NAN_ID = "commands.parameters.no_number"


# -- dangerous checks ------------------------------------------------------------------------------------


def test_dangerous_checks_come_last_and_need_their_own_option() -> None:
    checks = all_checks()
    dangerous = [found.dangerous for found in checks]
    assert dangerous == sorted(dangerous)
    assert NAN_ID in {found.name for found in checks if found.dangerous}
    allow = frozenset({ARM, REBOOT, ALTER})
    real = connected(BentWire(fleet(ready_s=0.0), without_simulator_mark))
    assert CRASH not in granted_permissions(real.identity, allow, ground_only=False)
    assert CRASH in granted_permissions(real.identity, allow | {CRASH}, ground_only=False)
    report = run(real, select([NAN_ID]))
    assert "--allow-crash" in report.results[0].seen


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -1.0, 1e30])
@pytest.mark.parametrize("command", [REQUEST, INTERVAL])
def test_no_other_check_can_send_a_message_id_that_is_no_number(command: int, number: float) -> None:
    vehicle = connected(BentWire(fleet(ready_s=0.0), without_simulator_mark))
    with pytest.raises(Skip, match="--allow-crash"):
        vehicle.send(vehicle.command_long(command, number))


def test_a_vehicle_that_a_dangerous_check_ends_was_restored_before() -> None:
    class FragileWire(FleetWire):
        """The vehicle ends at the first message id that is no number."""

        ended = False

        def send(self, data: bytes) -> None:
            for message in mavlink.MAVLink(None).parse_buffer(data) or ():
                if message.get_type() == "COMMAND_LONG" and message.param1 != message.param1:
                    self.ended = True
            if not self.ended:
                super().send(data)

        def receive(self, timeout_s: float) -> bytes | None:
            data = super().receive(timeout_s)
            return None if self.ended else data

    wire = FragileWire(fleet(ready_s=0.0))
    vehicle = connected(wire)
    items = store_mission(vehicle)
    report = run(vehicle, select(["mission.clear.empties", NAN_ID]))
    assert wire.ended
    assert named(report, Outcome.PASSED) == {"mission.clear.empties"}
    assert named(report, Outcome.FAILED) == {NAN_ID}
    assert [note for note in report.notes if "[vehicle-lost]" in note or "[not-restored]" in note] == []
    wire.ended = False
    assert has_mission(vehicle, items)


# -- reboots ---------------------------------------------------------------------------------------------


def test_the_run_goes_on_after_an_unasked_reboot() -> None:
    def reboots(vehicle: VehicleUnderTest) -> str:
        vehicle.expect_accepted(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        vehicle.wait(20.0)
        return "nothing noticed"

    wire = FleetWire(fleet(ready_s=0.0))
    vehicle = connected(wire)
    vehicle.wait(60.0)
    unasked, asked = one_check(reboots), one_check(reboots, REBOOT)
    report = run(vehicle, [unasked, asked, *select(["modes.set.manual"])])
    assert [result.outcome for result in report.results] == [Outcome.FAILED, Outcome.PASSED, Outcome.PASSED]
    assert "[rebooted]" in report.results[0].seen
    assert report.notes == ()


def test_a_vehicle_that_does_not_reboot_soon_after_its_boot_is_noticed() -> None:
    reboot = selects("COMMAND_LONG", command=mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, param1=1)
    report = conform(DroppingWire(fleet(ready_s=0.0), reboot, acknowledged), "reboot.answers_again")
    assert named(report, Outcome.FAILED) == {"reboot.answers_again"}


# -- requests --------------------------------------------------------------------------------------------


def test_a_check_starts_although_px4_denies_its_requests() -> None:
    """The stream then brings the message."""
    denied: list[Any] = []

    def denial(message: Any) -> list[Any]:
        denied.append(message)
        return [mavlink.MAVLink_command_ack_message(REQUEST, mavlink.MAV_RESULT_DENIED, 0, 0, 255, 190)]

    wire = DroppingWire(fleet("px4", ready_s=0.0), selects("COMMAND_LONG", command=REQUEST, param1=1), denial)
    assert named(conform(wire, "arming.arms_and_disarms"), Outcome.PASSED) == {"arming.arms_and_disarms"}
    assert denied


# -- restoration -----------------------------------------------------------------------------------------


def test_parameters_are_restored_on_a_vehicle_that_stays_armed() -> None:
    landing = (
        selects("COMMAND_LONG", command=mavlink.MAV_CMD_DO_SET_MODE),
        selects("COMMAND_LONG", command=mavlink.MAV_CMD_COMPONENT_ARM_DISARM, param1=0),
        selects("SET_MODE"),
    )

    def stays_armed(message: Any) -> bool:
        return state["armed"] and any(ends_the_flight(message) for ends_the_flight in landing)

    def arms_and_leaves_a_change(vehicle: VehicleUnderTest) -> str:
        before = parameters.read(vehicle, "RTL_ALT")
        vehicle.pending_restores["RTL_ALT"] = lambda: parameters.restore(vehicle, before)
        parameters.write(vehicle, "RTL_ALT", before.value + 1, before.type)
        flying.ensure_airborne(vehicle)
        state["armed"] = True
        return "armed"

    state = {"armed": False}
    inner = fleet(ready_s=0.0)
    vehicle = connected(DroppingWire(inner, stays_armed))
    before = parameters.read(vehicle, "RTL_ALT").value
    report = run(vehicle, [one_check(arms_and_leaves_a_change, ARM)])
    assert inner.truth().armed[0]
    assert any("[not-landed]" in note for note in report.notes)
    vehicle.begin_check()
    assert parameters.read(vehicle, "RTL_ALT").value == before


# -- connections -----------------------------------------------------------------------------------------


def test_a_burst_beyond_the_backlog_of_a_connection_is_sent_whole() -> None:
    piece, n_pieces, received = bytes(100_000), 300, bytearray()
    with socket.create_server(("127.0.0.1", 0)) as server:
        wire = LinkWire(parse_url(f"tcpout:127.0.0.1:{server.getsockname()[1]}"), 1.0)
        peer, _ = server.accept()

        def read() -> None:
            while data := peer.recv(65_536):
                received.extend(data)

        peer.send(b"connected")
        assert wire.receive(10.0) == b"connected"
        reader = threading.Thread(target=read)
        reader.start()
        for _ in range(n_pieces):
            wire.send(piece)
        assert wire.receive(0.5) is None
        wire.close()
        reader.join()
        peer.close()
    assert len(received) == n_pieces * len(piece)


def test_data_goes_to_a_udp_port_and_comes_back_from_it() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(10.0)
        wire = LinkWire(parse_url(f"udpout:127.0.0.1:{peer.getsockname()[1]}"), 1.0)
        with contextlib.closing(wire):
            wire.send(b"asked")
            data, address = peer.recvfrom(100)
            peer.sendto(b"answered", address)
            assert (data, wire.receive(10.0)) == (b"asked", b"answered")


def test_a_frame_goes_to_the_followed_vehicle_of_a_udp_port_alone() -> None:
    with contextlib.ExitStack() as stack:
        first, second = (stack.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(2))
        with socket.socket(type=socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        wire = stack.enter_context(contextlib.closing(LinkWire(parse_url(f"udpin:127.0.0.1:{port}"), 1.0)))
        for sysid, vehicle in ((1, first), (2, second)):
            vehicle.settimeout(10.0)
            frame = heartbeat().pack(mavlink.MAVLink(None, sysid, 1))
            vehicle.sendto(frame, ("127.0.0.1", port))
            assert wire.receive(10.0) == frame
        wire.send(b"to all")
        wire.follow(2)
        wire.send(b"to the second")
        assert second.recv(100) == b"to all"
        assert second.recv(100) == b"to the second"
        assert first.recv(100) == b"to all"
        first.setblocking(False)
        with pytest.raises(BlockingIOError):
            first.recv(100)


# -- the address of a system id on a UDP port ------------------------------------------------------------

A, B = ("127.0.0.1", 1), ("127.0.0.1", 2)


@pytest.mark.parametrize(
    ("received", "accepted", "address", "is_ambiguous"),
    [
        pytest.param([(A, 0.0), (B, 1.5)], [True, True], B, False, id="silent, then elsewhere"),
        # not even when the first has fallen silent
        pytest.param([(A, 0.0), (B, 0.4), (A, 0.8), (B, 60.0), (A, 61.0)], [True, False, True, False, True],
                     A, True, id="a second vehicle with the same id"),
        pytest.param([(A, 0.0), (B, 0.5), (B, 1.5)], [True, False, True], B, False, id="a quick reboot"),
    ],
)  # fmt: skip
def test_a_vehicle_may_return_at_another_address_and_a_second_one_is_ignored(
    received: list[tuple[Any, float]], accepted: list[bool], address: Any, is_ambiguous: bool
) -> None:
    senders = SenderAddresses()
    assert [senders.received(1, *each) for each in received] == accepted
    assert senders.address(1) == address
    assert senders.is_ambiguous(1) is is_ambiguous


def test_systems_behind_one_address_have_this_address() -> None:
    senders = SenderAddresses()
    assert all(senders.received(sysid, address, 0.0) for sysid, address in ((1, A), (2, A), (3, B)))
    assert [senders.address(sysid) for sysid in (1, 2, 3, 9)] == [A, A, B, None]


# -- the vehicle's clock ---------------------------------------------------------------------------------


def test_rates_hold_on_a_vehicle_at_half_the_expected_speed() -> None:
    class SlowWire(FleetWire):
        """A wire whose clock runs twice as fast as the vehicle's."""

        def now_s(self) -> float:
            return 2.0 * super().now_s()

        def receive(self, timeout_s: float) -> bytes | None:
            return super().receive(timeout_s / 2.0)

    def waits(vehicle: VehicleUnderTest) -> str:
        vehicle.wait(10.0)
        return "waited"

    checks = select(["messages.interval.4_hz", "messages.interval.10_hz", "heartbeat.once_a_second"])
    report = run(connected(SlowWire(fleet(ready_s=0.0))), [one_check(waits), *checks])
    assert [(r.check.name, r.seen) for r in report.results if r.outcome is Outcome.FAILED] == []
    report = run(connected(SlowWire(fleet(ready_s=0.0))), select(["heartbeat.once_a_second"]))
    assert report.count(Outcome.FAILED) == 1  # without a measurement

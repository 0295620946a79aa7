"""Examples of the fixtures: a user's ground station under test, on the virtual clock and over UDP.

Read from top to bottom as documentation; docs/simulator/testing.md has the first two.
"""

import socket
import time
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.spec import FaultError
from sim_vehicle.scenarios import ScenarioError
from sim_vehicle.testing.rig import Clock, NotWithinTimeError, Swarm, Vehicle
from sim_vehicle.testing.served import ServedFleet

pytest_plugins = ["sim_vehicle.pytest_plugin"]
MakeSwarm = Callable[..., Swarm]


class Lander:
    """A short ground station: it lands a vehicle with a low battery."""

    def __init__(self, send: Callable[[Any], object]) -> None:
        self._send = send
        self.landing = False

    def receive(self, message: Any) -> None:
        if message.get_type() == "BATTERY_STATUS" and message.battery_remaining < 30 and not self.landing:
            self.landing = True
            target, land = message.get_srcSystem(), mavlink.MAV_CMD_NAV_LAND
            self._send(mavlink.MAVLink_command_long_message(target, 1, land, 0, 0, 0, 0, 0, 0, 0, 0))


def test_a_vehicle_lands_on_a_low_battery(vehicle: Vehicle, clock: Clock) -> None:
    lander = Lander(vehicle.send)

    def pump() -> bool:
        while vehicle.received:
            lander.receive(vehicle.received.pop(0))
        return not vehicle.truth.airborne

    ask = mavlink.MAVLink_request_data_stream_message(vehicle.sysid, 1, mavlink.MAV_DATA_STREAM_ALL, 2, 1)
    vehicle.send(ask)
    vehicle.do("takeoff", 10)
    clock.run_until(lambda: vehicle.height_m > 9, timeout=30)
    vehicle.inject("battery_sag:at_most=0.2")
    clock.run_until(pump, timeout=60)
    assert lander.landing
    assert vehicle.mode == "LAND"


def test_a_fault_concerns_one_of_two_vehicles_with_the_same_system_id(swarm: MakeSwarm, clock: Clock) -> None:
    vehicles = swarm(count=251)
    first, last = vehicles[0], vehicles[-1]
    assert (first.sysid, first.link) == (1, 0)
    assert (last.sysid, last.link) == (1, 1)
    last.inject("battery_sag:at_most=0.2")
    clock.run_for(0.1)
    assert last.truth.battery_remaining < 0.21
    assert first.truth.battery_remaining > 0.9


def test_a_long_text_is_one_text(swarm: MakeSwarm) -> None:
    (vehicle,) = swarm(personality="px4", ready_s=10)
    arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    vehicle.send(mavlink.MAVLink_command_long_message(vehicle.sysid, 1, arm, 0, 1, 0, 0, 0, 0, 0, 0))
    assert len(vehicle.messages("STATUSTEXT")) > len(vehicle.texts)
    assert "Arming denied: Resolve system health failures first" in vehicle.texts


def test_a_fault_with_its_own_system_id_is_refused(vehicle: Vehicle) -> None:
    with pytest.raises(FaultError, match="remove sysid"):
        vehicle.inject("gps_loss:sysid=2")


# -- a ground station with a socket, under test in real time -----------------------------------------------


def received_sysids(url: str, wanted: int) -> set[int]:
    """Return the vehicles that a ground station hears on a link."""
    connection = mavutil.mavlink_connection(url, source_system=255)
    sysids: set[int] = set()
    while len(sysids) < wanted:
        connection.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        message = connection.recv_match(type="HEARTBEAT", blocking=True, timeout=1)
        if message is not None and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            sysids.add(message.get_srcSystem())
    connection.close()
    return sysids


@pytest.mark.interop
def test_every_vehicle_is_received_over_udp(swarm: MakeSwarm, link: ServedFleet) -> None:
    swarm(count=3, personality="mixed")
    assert received_sysids(link.url, wanted=3) == {1, 2, 3}


@pytest.mark.interop
def test_a_socket_is_enough(vehicle: Vehicle, link: ServedFleet, clock: Clock) -> None:
    link.serve(speedup=10)
    codec = mavlink.MAVLink(None, srcSystem=255)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.settimeout(10)
        heartbeat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 0, 3)
        station.sendto(heartbeat.pack(codec), link.address)
        data, _ = station.recvfrom(4096)
    assert data
    vehicle.do("takeoff", 5)
    clock.run_until(lambda: vehicle.height_m > 4, timeout=60)  # simulated seconds, here ten times as quick


@pytest.mark.interop
def test_lost_time_causes_a_warning_at_the_end(vehicle: Vehicle, link: ServedFleet, clock: Clock) -> None:
    link.serve(speedup=1_000_000)
    end_s = time.monotonic() + 1.1  # a lag of 1 s is reported
    clock.run_until(lambda: time.monotonic() > end_s, timeout=1e9)
    with pytest.warns(RuntimeWarning, match="too-slow"):
        link.close()


# -- further features ---------------------------------------------------------------------------------------


def test_time_stands_still_between_calls(vehicle: Vehicle, clock: Clock) -> None:
    assert clock.now == 0
    clock.run_for(2.5)
    assert clock.now == pytest.approx(2.5)
    before = len(vehicle.received)
    assert len(vehicle.received) == before
    took = clock.run_until(lambda: len(vehicle.messages("HEARTBEAT")) >= 5, timeout=10)
    assert 1.5 < took < 4
    assert clock.now == pytest.approx(2.5 + took)


def test_a_missed_condition_reports_the_state(vehicle: Vehicle, clock: Clock) -> None:
    with pytest.raises(NotWithinTimeError, match=r"(?s)3 s.*armed.*vehicle 1: STABILIZE"):
        clock.run_until(lambda: vehicle.armed, timeout=3)


def test_a_command_is_answered(vehicle: Vehicle, clock: Clock) -> None:
    clock.run_for(1)
    command = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    arm = mavlink.MAVLink_command_long_message(vehicle.sysid, 1, command, 0, 1, 0, 0, 0, 0, 0, 0)
    guided = mavlink.MAVLink_set_mode_message(vehicle.sysid, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 4)
    vehicle.send(guided)
    answers = vehicle.send(arm)
    assert [m.result for m in answers if m.get_type() == "COMMAND_ACK"] == [mavlink.MAV_RESULT_ACCEPTED]
    assert vehicle.armed
    vehicle.send(b"\x00garbage\xfd\x01")
    clock.run_for(1)
    assert vehicle.armed


def test_a_swarm_of_any_kind(swarm: MakeSwarm, clock: Clock) -> None:
    vehicles = swarm(count=4, personality="px4", faults=["link_outage:at=3,for=4,sysid=2"])
    clock.run_for(3)
    before = [len(vehicle.messages("HEARTBEAT")) for vehicle in vehicles]
    clock.run_for(3.5)
    after = [len(vehicle.messages("HEARTBEAT")) for vehicle in vehicles]
    assert [late - early >= 3 for early, late in zip(before, after, strict=True)] == [True, False, True, True]
    assert after[1] == before[1]


def test_a_step_that_fails_fails_the_test(vehicle: Vehicle, clock: Clock) -> None:
    vehicle.do("command", {"command": "DO_PARACHUTE", "params": [2]})
    with pytest.raises(NotWithinTimeError, match="vehicle 1: command"):
        clock.run_for(200)


@pytest.mark.parametrize(
    ("action", "found"),
    [
        (("land_on_the_moon",), "'land_on_the_moon'"),
        (("takeof", 5), "did you mean `takeoff`?"),
        (("takeoff",), "takeoff: "),
        (("mode", "Mission"), "vehicle 1 has no mode 'Mission'"),
        (("fly_mission",), "vehicle 1 has no `mission`"),
        (("heartbeat", False), "'heartbeat'"),
    ],
)
def test_an_impossible_action_is_an_error(vehicle: Vehicle, action: tuple[Any, ...], found: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        vehicle.do(*action)
    assert found in str(caught.value)


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ({"count": 0}, "count=0: "),
        ({"personality": "betaflight"}, "personality='betaflight': "),
        ({"kind": "plain"}, "kind='plain': did you mean `plane`?"),
        ({"personality": "px4", "params": {"RTL_ALT": 500}}, "px4 copter: RTL_ALT"),
        ({"faults": ["gps_los"]}, "gps_loss?"),
        ({"faults": "gps_loss"}, "faults='gps_loss'"),
        ({"wind": {"speed": 5}}, "wind.speed: "),
        ({"home": (91.0, 0.0, 0.0)}, "home=(91.0, 0.0, 0.0)"),
    ],
)
def test_an_impossible_swarm_is_an_error(swarm: MakeSwarm, options: dict[str, Any], found: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        swarm(**options)
    assert found in str(caught.value)


def test_each_test_has_one_fleet(vehicle: Vehicle, swarm: MakeSwarm) -> None:
    with pytest.raises(RuntimeError, match="swarm"):
        swarm(count=2)

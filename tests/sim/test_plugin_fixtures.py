"""The fixtures beyond the examples of docs/simulator/testing.md, which `test_sim_pages` runs."""

import time
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.spec import FaultError
from sim_vehicle.scenarios import ScenarioError
from sim_vehicle.testing.rig import Clock, NotWithinTimeError, Swarm, Vehicle
from sim_vehicle.testing.served import ServedFleet

pytest_plugins = ["sim_vehicle.pytest_plugin"]
MakeSwarm = Callable[..., Swarm]


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


@pytest.mark.interop
def test_lost_time_causes_a_warning_at_the_end(vehicle: Vehicle, link: ServedFleet, clock: Clock) -> None:
    link.serve(speedup=1_000_000)
    end_s = time.monotonic() + 1.1  # a lag of 1 s is reported
    clock.run_until(lambda: time.monotonic() > end_s, timeout=1e9)
    with pytest.warns(RuntimeWarning, match="too-slow"):
        link.close()


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

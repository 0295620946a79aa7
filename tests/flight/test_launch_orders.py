"""Launches by an operator's order, and checks that are repeated for them."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import pytest
from director_ground import Clearance, Ground
from flights import small

from swarmctl.core import events as ev
from swarmctl.core.events import Rebooted, TelemetryReceived
from swarmctl.core.frames import IntentPoint, IntentShared
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.own_vehicle import OwnVehicle

pytestmark = pytest.mark.virtual


def test_an_order_to_launch_waits_for_running_checks() -> None:
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(lasts_s=10.0))
    seen: list[tuple[float, list[str]]] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        now = asyncio.get_running_loop().time()
        if not seen and vehicles[0].state.phase == "standby":
            vehicles[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
            seen.append((now, []))
        if seen and "launch" in ground.links[0].calls:
            seen.append((now, []))
        return len(seen) > 1

    ground.fly(story)
    assert seen[1][0] - seen[0][0] == pytest.approx(10.0, abs=0.5)


def test_a_vehicle_launches_by_its_order_alone_and_is_made_ready_again_after_a_reboot() -> None:
    ground = Ground(small(simulate={"count": 2}), launch="ordered")
    moments: list[str] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        phases = {m.state.phase for m in vehicles}
        if phases == {"standby"} and len(moments) < 50:
            moments.append("ready")
            if len(moments) == 20:
                vehicles[1].runner.on_link_event(Rebooted())
            if len(moments) == 50:
                vehicles[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
        return vehicles[0].state.phase == "flying"

    ground.fly(story)
    assert len(moments) == 50
    assert ground.links[0].calls == ["connect", "prepare", "upload", "identify", "launch"]
    assert ground.links[1].calls == ["connect", "prepare", "upload", "prepare", "upload"]


def test_a_vehicle_waiting_for_its_order_may_fall_silent_for_any_time() -> None:
    ground = Ground(small(simulate={"count": 2}, flight={"lost_timeout_s": 2.0}), launch="ordered")
    waited: list[str] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        if not waited and all(m.state.phase == "standby" for m in vehicles):
            ground.links[0].age = 99.0
            vehicles[0].runner.post(ev.LinkLost(5.0))
        waited.append(vehicles[0].state.phase)
        if len(waited) == 300:
            vehicles[0].runner.post(ev.LinkRestored())
            vehicles[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
        return vehicles[0].state.phase == "flying"

    ground.fly(story)
    assert len(waited) > 300


@pytest.mark.parametrize(("waits_s", "checks"), [(20.0, 1), (40.0, 2)])
@pytest.mark.parametrize("fit", [True, False])
def test_checks_long_before_the_order_to_launch_are_repeated(waits_s: float, checks: int, fit: bool) -> None:
    """The battery may have drained meanwhile, or another station cleared the fence."""
    verdicts = [[], [] if fit else ["uav1: fence: found 0 corners; wanted 4"]]
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(verdicts))
    standby_s: list[float] = []
    ordered_s: list[float] = []
    trouble: list[str] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        state, now = vehicles[0].state, asyncio.get_running_loop().time()
        if state.phase == "standby":
            standby_s.append(now)
            if not ordered_s and now - standby_s[0] >= waits_s:
                vehicles[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
                ordered_s.append(now)
        trouble[:] = [state.trouble]
        return state.phase == "flying" or (bool(ordered_s) and now - ordered_s[0] > 20.0)

    ground.fly(story)
    assert ground.clearance.calls.count(("check", "uav1")) == checks
    is_launched = fit or checks == 1
    assert ("launch" in ground.links[0].calls) == is_launched
    assert (" 0 corners" in trouble[0]) == (not is_launched)


def test_a_launch_waits_for_a_vehicle_that_enters_its_route_during_the_checks() -> None:
    """The checks between the order and the arming may take half a minute."""
    scenario = small(simulate={"count": 1}, threats={"count": 0})
    ground = Ground(scenario, launch="ordered", clearance=Clearance(lasts_s=10.0))
    frame, (lat_deg, lon_deg) = scenario.grid.frame, scenario.specs[0].start
    there = frame.to_geodetic(*scenario.grid.centre_m(scenario.tasks[0].goals[0]))
    hovers = IntentShared(1, tuple(IntentPoint(t, *there, 315.0) for t in (0.0, 600.0)))
    ordered_s: list[float] = []
    standby_s: list[float] = []
    launched_s: list[float] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        runner, now = vehicles[0].runner, asyncio.get_running_loop().time()
        here = VehicleState(now, lat_deg=lat_deg, lon_deg=lon_deg, alt_rel_m=0.0, alt_amsl_m=300.0)
        runner.on_link_event(TelemetryReceived(replace(here, home_lat_deg=lat_deg, home_lon_deg=lon_deg)))
        if runner.state.phase == "standby" and not standby_s:
            standby_s.append(now)
        if standby_s and not ordered_s and now - standby_s[0] >= 45.0:
            runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
            ordered_s.append(now)
        if ordered_s and now - ordered_s[0] >= 5.0:
            is_there = now - ordered_s[0] < 30.0
            told = ((7, 0.0, hovers if is_there else IntentShared(1, ())),)
            runner.post(ev.TelemetryReceived(runner.state.vehicle, intents=told))
        if "launch" in ground.links[0].calls and not launched_s:
            launched_s.append(now)
        return bool(launched_s)

    ground.fly(story)
    assert ground.clearance.calls.count(("check", "uav1")) >= 2
    assert launched_s[0] - ordered_s[0] >= 30.0


def test_the_next_order_repeats_checks_that_failed_at_the_first() -> None:
    verdicts = [[], ["uav1: battery: found 40 %; wanted 60 %"]]
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(verdicts))
    ordered_s: list[float] = []
    waits_s: list[float] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        state, now = vehicles[0].state, asyncio.get_running_loop().time()
        if state.phase == "standby":
            waits_s.append(now)
            if now - [waits_s[0], *ordered_s][-1] >= 40.0:  # the checks are too old by then
                vehicles[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
                ordered_s.append(now)
        return state.phase == "flying" or state.ended

    ground.fly(story)
    assert len(ordered_s) == 2
    assert ground.links[0].calls.count("launch") == 1


def test_a_vehicle_that_reboots_after_a_forbidden_launch_is_made_ready_again() -> None:
    verdicts = [[], ["uav1: battery: found 40 %; wanted 60 %"]]
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(verdicts))
    moments: list[float] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        state, now = vehicles[0].state, asyncio.get_running_loop().time()
        if state.phase == "standby":
            moments.append(now)
            if len(moments) == 400:
                vehicles[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
            if len(moments) == 450:
                vehicles[0].runner.on_link_event(Rebooted())
        return len(moments) == 600

    ground.fly(story)
    assert ground.links[0].calls.count("upload") == 2


def test_a_vehicle_with_a_long_launch_delay_is_checked_again() -> None:
    ground = Ground(small(simulate={"count": 2, "delay_step_s": 60.0}))

    def worse(vehicles: Sequence[OwnVehicle]) -> bool:
        if vehicles[0].state.phase == "flying":
            ground.clearance.verdicts = [["uav2: battery: found 12 %"]]
        return vehicles[1].state.ended

    ground.fly(worse)
    assert "launch" in ground.links[0].calls
    assert "launch" not in ground.links[1].calls


def test_a_vehicle_that_reboots_during_repeated_checks_is_not_launched() -> None:
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(lasts_s=10.0))
    begun_s: list[float] = []

    def story(vehicles: Sequence[OwnVehicle]) -> bool:
        runner, now = vehicles[0].runner, asyncio.get_running_loop().time()
        if runner.clearance.is_fresh or not runner.clearance.is_given:
            return vehicles[0].state.ended or bool(begun_s and now - begun_s[0] > 20.0)
        if not begun_s:
            begun_s.append(now)
            runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
        elif 5.0 < now - begun_s[0] < 6.0:
            runner.on_link_event(Rebooted())
        return vehicles[0].state.ended

    ground.fly(story)
    assert begun_s
    assert "launch" not in ground.links[0].calls

"""The director: reasons that keep a swarm on the ground, and its launch."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from director_ground import WAITING_FOR, Clearance, Ground, StubLink, all_launched, runner_of
from flights import small

from swarmctl.core import events as ev
from swarmctl.core.events import Rebooted
from swarmctl.flight.arming_clearance import LaunchNotPermitted
from swarmctl.flight.director import NOT_READY_S
from swarmctl.flight.own_vehicle import OwnVehicle
from swarmctl.flight.permission import PreflightFailed
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links.base import LaunchFailed, NoAnswer, NotReady, SystemIdConflict, UploadFailed
from swarmctl.mavlink.events import Identity

pytestmark = pytest.mark.virtual


def test_simulated_vehicles_launch_without_permission() -> None:
    ground = Ground()
    ground.fly(all_launched)
    assert [link.calls for link in ground.links] == [
        ["connect", "prepare", "upload", "identify", "launch"]
    ] * 3
    assert ground.asked == []


def test_an_autopilot_in_the_place_of_a_simulated_vehicle_stops_the_flight() -> None:
    ground = Ground(identities={2: b"\x12\x34"})
    with pytest.raises(PreflightFailed, match=r"^uav2: .*\[not-simulated\]$"):
        ground.fly(all_launched)
    assert [link.calls for link in ground.links] == [["connect"]] * 3


@pytest.mark.parametrize("uid2", [b"", b"sim_vehicle", b"sim_vehicleX", b"Sim_vehicle\0"])
def test_only_the_exact_mark_is_a_simulator(uid2: bytes) -> None:
    simulated = Identity(1, 3, 2, "", uid2.ljust(18, b"\xff") if uid2 == b"sim_vehicle" else uid2).simulated
    assert not simulated


def test_permission_is_asked_for_exactly_the_vehicles_that_are_not_simulated() -> None:
    ground = Ground(simulated=False, identities={2: b"\x12\x34"})
    ground.fly(all_launched)
    assert ground.asked == ["uav2"]


def test_without_permission_no_vehicle_is_prepared() -> None:
    ground = Ground(simulated=False, identities={2: b"\x12\x34"}, allowed=False)
    with pytest.raises(PreflightFailed, match="not allowed"):
        ground.fly(all_launched)
    assert {call for link in ground.links for call in link.calls} == {"connect"}


def test_a_launch_without_permission_is_a_bug_and_no_take_off() -> None:
    async def scene() -> StubLink:
        link = StubLink()
        runner = runner_of(small(), link)
        runner.post(ev.Ready())
        runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH))
        with pytest.raises(ExceptionGroup) as raised:
            await runner.run()
        assert isinstance(raised.value.exceptions[0], LaunchNotPermitted)
        return link

    assert "launch" not in run_virtual(scene()).calls


TROUBLE: list[tuple[Exception, str]] = [
    (NoAnswer("uav2: no answer", url="u", sysid=2, tried_s=1.0), "no answer"),
    (NotReady("uav2: not ready", reasons=("no GPS",)), "not ready"),
    (UploadFailed("uav2: not verified"), "not verified"),
]


@pytest.mark.parametrize(("failure", "reason"), TROUBLE, ids=["silent", "not ready", "mission refused"])
def test_one_vehicle_in_trouble_keeps_all_on_the_ground(failure: Exception, reason: str) -> None:
    ground = Ground(fails={2: failure})
    with pytest.raises(PreflightFailed, match=reason):
        ground.fly(all_launched)
    assert all("launch" not in link.calls for link in ground.links)


def test_a_failed_upload_is_repeated_twice() -> None:
    ground = Ground(fails={1: UploadFailed("uav1: not verified")})
    with pytest.raises(PreflightFailed):
        ground.fly(all_launched)
    assert [link.calls.count("upload") for link in ground.links] == [3, 1, 1]


def test_another_vehicle_at_the_same_address_is_not_launched() -> None:
    ground = Ground()
    states: list[str] = []

    def settled(vehicles: Sequence[OwnVehicle]) -> bool:
        ground.links[1].answers = Identity(2, 3, 2, "ArduPilot 4.6.2", bytes(range(18)))
        states[:] = [m.state.outcome for m in vehicles]
        return [m.state.phase for m in vehicles] == ["flying", "failed", "flying"]

    ground.fly(settled)
    assert "[other-vehicle]" in states[1]
    assert "launch" not in ground.links[1].calls


def test_two_senders_with_one_system_id_keep_all_on_the_ground() -> None:
    ground = Ground()

    def conflicting(vehicles: Sequence[OwnVehicle]) -> bool:
        vehicles[2].runner.on_link_event(SystemIdConflict("127.0.0.1:9"))
        return False

    with pytest.raises(PreflightFailed, match=r"^uav3: .*127\.0\.0\.1:9"):
        ground.fly(conflicting)
    assert {call for link in ground.links for call in link.calls} == {"connect"}


def test_a_vehicle_that_falls_silent_before_the_launch_keeps_all_on_the_ground() -> None:
    ground = Ground()

    def silenced(vehicles: Sequence[OwnVehicle]) -> bool:
        vehicles[0].runner.post(ev.LinkLost(5.0))
        return False

    with pytest.raises(PreflightFailed, match="uav1: lost"):
        ground.fly(silenced)
    assert all("launch" not in link.calls for link in ground.links)


def test_a_vehicle_that_reboots_during_its_delay_is_made_ready_again() -> None:
    scenario = small(simulate={"count": 2, "delay_step_s": 20.0})
    ground = Ground(scenario)
    booted: list[bool] = []

    def boot_once(vehicles: Sequence[OwnVehicle]) -> bool:
        if not booted and vehicles[0].state.phase == "flying":
            booted.append(True)
            vehicles[1].runner.on_link_event(Rebooted())
        return all_launched(vehicles)

    ground.fly(boot_once)
    assert ground.links[1].calls == [
        "connect",
        "prepare",
        "upload",
        "prepare",
        "upload",
        "identify",
        "launch",
    ]


def test_vehicles_are_set_up_before_and_checked_after_they_have_their_missions() -> None:
    ground = Ground()
    ground.fly(all_launched)
    *set_up, checks = ground.clearance.calls
    assert sorted(set_up) == [("set up", f"uav{n}") for n in (1, 2, 3)]
    assert checks == ("check", "uav1", "uav2", "uav3")


def test_failed_checks_arm_no_vehicle_and_are_reported_together() -> None:
    ground = Ground(clearance=Clearance([["uav1: battery: ...", "uav3: fence: ..."]]))
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    assert raised.value.lines == ("uav1: battery: ...", "uav3: fence: ...")
    assert [link.calls for link in ground.links] == [["connect", "prepare", "upload"]] * 3


def test_a_vehicle_that_is_not_ready_does_not_hide_failures_of_others() -> None:
    ground = Ground(
        fails={2: NotReady("uav2: not ready", reasons=())}, clearance=Clearance([["uav3: fence: ..."]])
    )
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    assert raised.value.lines == ("uav2: not ready", "uav3: fence: ...")


def times_of(ground: Ground, text: str) -> list[float]:
    return [at_s for at_s, line in ground.said if line.startswith(text)]


def test_failures_are_reported_while_other_vehicles_get_ready() -> None:
    ground = Ground(
        prepares_s={2: 60.0},
        fails={3: NotReady("uav3: not ready", reasons=())},
        clearance=Clearance([["uav1: fence: ..."]], early={"uav1": ["uav1: fence: ..."]}),
    )
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    (fence_s,), (not_ready_s,) = times_of(ground, "uav1: fence"), times_of(ground, "uav3: not ready")
    assert fence_s < 10.0
    assert not_ready_s < 1.0
    assert raised.value.lines == ("uav3: not ready", "uav1: fence: ...")
    assert ground.clearance.calls.count(("check early", "uav1")) == 1
    assert all("launch" not in link.calls for link in ground.links)


def test_no_early_checks_run_when_all_vehicles_are_ready_at_once() -> None:
    ground = Ground()
    ground.fly(all_launched)
    assert not [call for call in ground.clearance.calls if call[0] == "check early"]


def test_early_checks_launch_no_vehicle() -> None:
    ground = Ground(prepares_s={2: 30.0}, clearance=Clearance([["uav1: battery: ..."]]))
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    assert ("check early", "uav1") in ground.clearance.calls
    assert raised.value.lines == ("uav1: battery: ...",)


def test_preflight_without_launch_gives_no_permission_to_arm() -> None:
    ground = Ground(launch="never", simulated=False, identities={2: b"\x12\x34"})
    ground.fly(lambda vehicles: any(m.runner.clearance.is_permitted for m in vehicles))
    assert [link.calls for link in ground.links] == [["connect", "prepare", "upload"]] * 3
    assert ground.asked == []


def test_a_vehicle_that_reboots_before_its_launch_is_checked_again() -> None:
    ground = Ground(small(simulate={"count": 2, "delay_step_s": 4.0}))
    booted: list[bool] = []

    def boot_once(vehicles: Sequence[OwnVehicle]) -> bool:
        if not booted and vehicles[0].state.phase == "flying":
            booted.append(True)
            vehicles[1].runner.on_link_event(Rebooted())
            ground.clearance.verdicts = [["uav2: gps: ..."]]
        return bool(booted) and vehicles[1].state.ended

    ground.fly(boot_once)
    assert ground.clearance.calls[-2:] == [("set up", "uav2"), ("check", "uav2")]
    assert "launch" in ground.links[0].calls
    assert "launch" not in ground.links[1].calls


def test_a_vehicle_far_from_its_start_is_not_flown() -> None:
    ground = Ground(moved={3: (46.01, 14.4)})
    with pytest.raises(PreflightFailed, match=r"^uav3: \d+ m .*\[start-distance\]$"):
        ground.fly(all_launched)
    assert all("launch" not in link.calls for link in ground.links)


def test_a_failed_launch_does_not_stop_other_vehicles() -> None:
    ground = Ground(fails={1: LaunchFailed("uav1: arming refused")})
    states: list[tuple[str, str]] = []

    def settled(vehicles: Sequence[OwnVehicle]) -> bool:
        states[:] = [(m.state.phase, m.state.outcome) for m in vehicles]
        return [phase for phase, _ in states] == ["failed", "flying", "flying"]

    ground.fly(settled)
    assert "arming refused" in states[0][1]


@pytest.mark.parametrize(("count", "named"), [(1, True), (2, False)])
def test_readiness_is_reported_with_the_name_of_a_single_vehicle(count: int, named: bool) -> None:
    ground = Ground(small(simulate={"count": count}), launch="ordered")
    ground.fly(lambda _: any(text.endswith("[ready]") for _, text in ground.said))
    (line,) = (text for _, text in ground.said if text.endswith("[ready]"))
    assert ("uav1" in line) is named


@pytest.mark.parametrize(("prepares_s", "reported_s"), [(NOT_READY_S - 5.0, []), (50.0, [20.0, 40.0])])
def test_only_a_long_wait_for_readiness_is_reported(prepares_s: float, reported_s: list[float]) -> None:
    ground = Ground(small(simulate={"count": 1}), prepares_s={1: prepares_s})
    ground.fly(all_launched)
    lines = [(at_s, text) for at_s, text in ground.said if text.endswith("[not-ready]")]
    assert [at_s for at_s, _ in lines] == pytest.approx(reported_s, abs=2.0)
    assert all(WAITING_FOR in text for _, text in lines)

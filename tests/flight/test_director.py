"""What keeps a swarm on the ground: identity, permission, readiness, place."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from flights import small

from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentPoint, IntentShared
from swarmctl.core.inference.sensor import PERFECT
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.director import Director, Launch, PreflightFailed
from swarmctl.flight.member import Member
from swarmctl.flight.network import network_of
from swarmctl.flight.runner import LaunchNotPermitted, Runner
from swarmctl.flight.sensors.footprint import Footprint
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links.base import (
    CommandFailed,
    Conflict,
    Identity,
    LaunchBlockedError,
    LaunchFailed,
    NoAnswer,
    NotReady,
    StateChanged,
    UploadFailed,
    VehicleRebooted,
)
from swarmctl.mavlink.protocol.outcome import Swapped

pytestmark = pytest.mark.virtual

MARK = b"sim_vehicle\0"


@dataclass
class StubLink:
    """Does at once what it is told, and remembers it."""

    identity: Identity
    where: tuple[float, float]
    fails: Exception | None = None
    calls: list[str] = field(default_factory=list)
    answers: Identity | None = None
    """who answers later, if not the same"""
    age: float = 0.0
    prepares_s: float = 0.0

    async def _do(self, name: str, *failures: type[Exception]) -> None:
        self.calls.append(name)
        if isinstance(self.fails, failures):
            raise self.fails

    async def connect(self, timeout_s: float) -> Identity:
        await self._do("connect", NoAnswer)
        return self.identity

    async def identify(self, timeout_s: float) -> Identity:
        await self._do("identify")
        return self.answers or self.identity

    async def prepare(self, timeout_s: float, on_waiting: Callable[[tuple[str, ...]], None]) -> None:
        await asyncio.sleep(self.prepares_s)
        await self._do("prepare", NotReady)

    async def upload(self, plan: FlightPlan) -> float:
        await self._do("upload", UploadFailed)
        return 0.0

    async def launch(self, in_the_way: Callable[[], str] = lambda: "") -> None:
        if why := in_the_way():
            raise LaunchBlockedError(f"put off: {why}", why=why, was_armed=False)
        await self._do("launch", LaunchFailed)

    async def swap(self, plan: FlightPlan) -> Swapped:
        await self._do("swap")
        return Swapped(None, "new", 0.0, 0.5)

    async def hold(self) -> None:
        await self._do("hold", CommandFailed)

    async def return_home(self) -> None:
        await self._do("return_home")

    async def land(self) -> None:
        await self._do("land")

    def state(self) -> VehicleState:
        return VehicleState(lat_deg=self.where[0], lon_deg=self.where[1], alt_rel_m=0.0)

    def age_s(self) -> float:
        return self.age

    def items(self) -> tuple[MissionItem, ...]:
        return ()

    def close(self) -> None: ...


@dataclass
class Clearance:
    """Preflight checks: by default they pass; `verdicts` are those of the next looks."""

    verdicts: list[list[str]] = field(default_factory=list)
    calls: list[tuple[str, ...]] = field(default_factory=list)
    lasts_s: float = 0.0
    early: dict[str, list[str]] = field(default_factory=dict)
    """what is found of whom while others are waited for"""

    async def set_up(self, subject: Member) -> None:
        self.calls.append(("set up", subject.name))

    async def failures(self, subjects: Sequence[Member], everyone: Sequence[Member]) -> list[str]:
        self.calls.append(("check", *(s.name for s in subjects)))
        await asyncio.sleep(self.lasts_s)
        return self.verdicts.pop(0) if self.verdicts else []

    async def found_early(self, subject: Member, everyone: Sequence[Member]) -> list[str]:
        self.calls.append(("look at", subject.name))
        return self.early.get(subject.name, [])


@dataclass
class Ground:
    """A swarm of stub links with its director."""

    scenario: Scenario = field(default_factory=small)
    identities: dict[int, bytes] = field(default_factory=dict)
    fails: dict[int, Exception] = field(default_factory=dict)
    moved: dict[int, tuple[float, float]] = field(default_factory=dict)
    simulated: bool = True
    allowed: bool = True
    launch: Launch = "when-ready"
    clearance: Clearance = field(default_factory=Clearance)
    links: list[StubLink] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    prepares_s: dict[int, float] = field(default_factory=dict)
    said: list[tuple[float, str]] = field(default_factory=list)
    """when, on the virtual clock"""

    def fly(self, until: Callable[[Sequence[Member]], bool]) -> None:
        run_virtual(self._fly(until))

    async def _fly(self, until: Callable[[Sequence[Member]], bool]) -> None:
        network = network_of(self.scenario, MemoryBus(), RunClock(0.0))
        members = [self._member(index, network) for index in range(len(self.scenario.specs))]
        director = Director(
            members,
            self.scenario.config.flight,
            seconds_per_delay=1.0,
            say=lambda text: self.said.append((asyncio.get_running_loop().time(), text)),
            permission=self._permit,
            clearance=self.clearance,
            launch=self.launch,
        )
        runs = [asyncio.create_task(m.runner.run()) for m in members]
        flight = asyncio.create_task(director.fly())
        try:
            async with asyncio.timeout(100.0):
                while not (flight.done() or until(members)):  # noqa: ASYNC110
                    await asyncio.sleep(0.1)
            if flight.done():
                flight.result()
        finally:
            for task in (flight, *runs):
                task.cancel()
            await asyncio.gather(flight, *runs, return_exceptions=True)

    def _member(self, index: int, network: Network) -> Member:
        spec = replace(self.scenario.specs[index], simulated=self.simulated)
        uid2 = self.identities.get(spec.sysid, MARK)
        link = StubLink(
            Identity(spec.sysid, 3, 2, "ArduPilot 4.6.2", uid2.ljust(18, b"\0")),
            self.moved.get(spec.sysid, spec.start),
            self.fails.get(spec.sysid),
            prepares_s=self.prepares_s.get(spec.sysid, 0.0),
        )
        self.links.append(link)
        sensor = Footprint(self.scenario.grid, self.scenario.hostiles, PERFECT, np.random.default_rng(0))
        return Member(
            spec, Runner(self.scenario.tasks[index], self.scenario.prior, link, sensor, network, ())
        )

    def _permit(self, foreign: Sequence[Member]) -> None:
        self.asked += [m.name for m in foreign]
        if not self.allowed:
            raise PreflightFailed(["not allowed"])


def all_launched(members: Sequence[Member]) -> bool:
    return all(m.state.phase == "flying" for m in members)


CALLS = ["connect", "prepare", "upload", "identify", "launch"]


def test_simulated_vehicles_launch_without_being_asked_for() -> None:
    ground = Ground()
    ground.fly(all_launched)
    assert [link.calls for link in ground.links] == [
        ["connect", "prepare", "upload", "identify", "launch"]
    ] * 3
    assert ground.asked == []


def test_an_autopilot_in_the_place_of_a_simulated_vehicle_stops_all() -> None:
    ground = Ground(identities={2: b"\x12\x34"})
    with pytest.raises(PreflightFailed, match="uav2: expected a vehicle of the built-in simulator"):
        ground.fly(all_launched)
    assert [link.calls for link in ground.links] == [["connect"]] * 3


@pytest.mark.parametrize("uid2", [b"", b"sim_vehicle", b"sim_vehicleX", b"Sim_vehicle\0"])
def test_only_the_exact_mark_is_a_simulator(uid2: bytes) -> None:
    simulated = Identity(1, 3, 2, "", uid2.ljust(18, b"\xff") if uid2 == b"sim_vehicle" else uid2).simulated
    assert not simulated


def test_what_is_not_simulated_needs_permission_for_exactly_that_vehicle() -> None:
    ground = Ground(simulated=False, identities={2: b"\x12\x34"})
    ground.fly(all_launched)
    assert ground.asked == ["uav2"]


def test_without_permission_nothing_is_even_prepared() -> None:
    ground = Ground(simulated=False, identities={2: b"\x12\x34"}, allowed=False)
    with pytest.raises(PreflightFailed, match="not allowed"):
        ground.fly(all_launched)
    assert {call for link in ground.links for call in link.calls} == {"connect"}


def test_a_launch_that_nobody_allowed_is_a_bug_not_a_take_off() -> None:
    async def scene() -> StubLink:
        scenario = small()
        link = StubLink(Identity(1, 3, 2, "", MARK), scenario.specs[0].start)
        runner = Runner(
            scenario.tasks[0],
            scenario.prior,
            link,
            Footprint(scenario.grid, frozenset(), PERFECT, np.random.default_rng(0)),
            network_of(scenario, MemoryBus(), RunClock(0.0)),
            (),
        )
        runner.post(ev.Ready())
        runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH))
        with pytest.raises(ExceptionGroup) as raised:
            await runner.run()
        assert isinstance(raised.value.exceptions[0], LaunchNotPermitted)
        return link

    assert "launch" not in run_virtual(scene()).calls


TROUBLE: list[tuple[Exception, str]] = [
    (NoAnswer("uav2: nobody answers", url="u", sysid=2, tried_s=1.0), "nobody answers"),
    (NotReady("uav2: not ready", reasons=("no GPS",)), "not ready"),
    (UploadFailed("uav2: not verified"), "not verified"),
]


@pytest.mark.parametrize(("failure", "said"), TROUBLE, ids=["silent", "not ready", "mission refused"])
def test_one_vehicle_in_trouble_keeps_all_on_the_ground(failure: Exception, said: str) -> None:
    ground = Ground(fails={2: failure})
    with pytest.raises(PreflightFailed, match=said):
        ground.fly(all_launched)
    assert all("launch" not in link.calls for link in ground.links)


def test_another_vehicle_at_the_same_address_is_not_launched() -> None:
    ground = Ground()
    states: list[str] = []

    def settled(members: Sequence[Member]) -> bool:
        ground.links[1].answers = Identity(2, 3, 2, "ArduPilot 4.6.2", bytes(range(18)))
        states[:] = [m.state.outcome for m in members]
        return [m.state.phase for m in members] == ["flying", "failed", "flying"]

    ground.fly(settled)
    assert "another vehicle answers than the one that may be armed" in states[1]
    assert "launch" not in ground.links[1].calls


def test_two_senders_with_one_system_id_keep_all_on_the_ground() -> None:
    ground = Ground()

    def conflicting(members: Sequence[Member]) -> bool:
        members[2].runner.on_link_event(Conflict("127.0.0.1:9"))
        return False

    with pytest.raises(PreflightFailed, match=r"uav3: another sender, at 127\.0\.0\.1:9, uses its"):
        ground.fly(conflicting)
    assert {call for link in ground.links for call in link.calls} == {"connect"}


def test_a_vehicle_that_falls_silent_before_the_launch_keeps_all_on_the_ground() -> None:
    ground = Ground()

    def silenced(members: Sequence[Member]) -> bool:
        members[0].runner.post(ev.LinkLost(5.0))
        return False

    with pytest.raises(PreflightFailed, match="uav1: lost"):
        ground.fly(silenced)
    assert all("launch" not in link.calls for link in ground.links)


def test_a_vehicle_that_boots_while_it_waits_for_its_turn_is_made_ready_again() -> None:
    scenario = small(simulate={"count": 2, "delay_step_s": 20.0})
    ground = Ground(scenario)
    booted: list[bool] = []

    def boot_once(members: Sequence[Member]) -> bool:
        if not booted and members[0].state.phase == "flying":
            booted.append(True)
            members[1].runner.on_link_event(VehicleRebooted())
        return all_launched(members)

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


def test_all_are_set_up_before_and_checked_after_they_have_their_missions() -> None:
    ground = Ground()
    ground.fly(all_launched)
    *set_up, checks = ground.clearance.calls
    assert sorted(set_up) == [("set up", f"uav{n}") for n in (1, 2, 3)]
    assert checks == ("check", "uav1", "uav2", "uav3")


def test_checks_that_fail_arm_nobody_and_are_said_together() -> None:
    ground = Ground(clearance=Clearance([["uav1: battery: ...", "uav3: fence: ..."]]))
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    assert raised.value.lines == ("uav1: battery: ...", "uav3: fence: ...")
    assert [link.calls for link in ground.links] == [["connect", "prepare", "upload"]] * 3


def test_what_a_vehicle_that_is_not_ready_hides_of_the_others_is_said_too() -> None:
    ground = Ground(
        fails={2: NotReady("uav2: not ready", reasons=())}, clearance=Clearance([["uav3: fence: ..."]])
    )
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    assert raised.value.lines == ("uav2: not ready", "uav3: fence: ...")


def when_said(ground: Ground, text: str) -> list[float]:
    return [at_s for at_s, said in ground.said if said.startswith(text)]


def test_what_is_wrong_with_others_is_said_while_one_is_waited_for() -> None:
    ground = Ground(
        prepares_s={2: 60.0},
        fails={3: NotReady("uav3: not ready", reasons=())},
        clearance=Clearance([["uav1: fence: ..."]], early={"uav1": ["uav1: fence: ..."]}),
    )
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    (fence_s,), (not_ready_s,) = when_said(ground, "uav1: fence"), when_said(ground, "uav3: not ready")
    assert fence_s < 10.0
    assert not_ready_s < 1.0
    assert raised.value.lines == ("uav3: not ready", "uav1: fence: ...")
    assert ground.clearance.calls.count(("look at", "uav1")) == 1
    assert all("launch" not in link.calls for link in ground.links)


def test_nobody_is_looked_at_early_where_all_are_ready_at_once() -> None:
    ground = Ground()
    ground.fly(all_launched)
    assert not [call for call in ground.clearance.calls if call[0] == "look at"]


def test_what_passes_early_launches_nobody() -> None:
    ground = Ground(prepares_s={2: 30.0}, clearance=Clearance([["uav1: battery: ..."]]))
    with pytest.raises(PreflightFailed) as raised:
        ground.fly(all_launched)
    assert ("look at", "uav1") in ground.clearance.calls
    assert raised.value.lines == ("uav1: battery: ...",)


def test_checks_alone_give_nobody_the_permission_to_arm() -> None:
    ground = Ground(launch="never", simulated=False, identities={2: b"\x12\x34"})
    ground.fly(lambda members: any(m.runner.armable for m in members))
    assert [link.calls for link in ground.links] == [["connect", "prepare", "upload"]] * 3
    assert ground.asked == []


def test_a_vehicle_that_boots_before_its_launch_is_checked_anew() -> None:
    ground = Ground(small(simulate={"count": 2, "delay_step_s": 4.0}))
    booted: list[bool] = []

    def boot_once(members: Sequence[Member]) -> bool:
        if not booted and members[0].state.phase == "flying":
            booted.append(True)
            members[1].runner.on_link_event(VehicleRebooted())
            ground.clearance.verdicts = [["uav2: gps: ..."]]
        return bool(booted) and members[1].state.ended

    ground.fly(boot_once)
    assert ground.clearance.calls[-2:] == [("set up", "uav2"), ("check", "uav2")]
    assert "launch" in ground.links[0].calls
    assert "launch" not in ground.links[1].calls


def test_an_order_to_launch_waits_for_checks_that_are_under_way() -> None:
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(lasts_s=10.0))
    seen: list[tuple[float, list[str]]] = []

    def story(members: Sequence[Member]) -> bool:
        now = asyncio.get_running_loop().time()
        if not seen and members[0].state.phase == "standby":
            members[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
            seen.append((now, []))
        if seen and "launch" in ground.links[0].calls:
            seen.append((now, []))
        return len(seen) > 1

    ground.fly(story)
    assert seen[1][0] - seen[0][0] == pytest.approx(10.0, abs=0.5)


def test_a_vehicle_far_from_its_start_is_not_flown() -> None:
    ground = Ground(moved={3: (46.01, 14.4)})
    with pytest.raises(PreflightFailed, match=r"uav3: it stands \d+ m from its configured start"):
        ground.fly(all_launched)
    assert all("launch" not in link.calls for link in ground.links)


def test_a_launch_that_fails_does_not_stop_the_others() -> None:
    ground = Ground(fails={1: LaunchFailed("uav1: arming refused")})
    states: list[tuple[str, str]] = []

    def settled(members: Sequence[Member]) -> bool:
        states[:] = [(m.state.phase, m.state.outcome) for m in members]
        return [phase for phase, _ in states] == ["failed", "flying", "flying"]

    ground.fly(settled)
    assert "arming refused" in states[0][1]


def test_who_waits_for_an_order_is_launched_by_it_alone_and_made_ready_again_after_a_boot() -> None:
    ground = Ground(small(simulate={"count": 2}), launch="ordered")
    moments: list[str] = []

    def story(members: Sequence[Member]) -> bool:
        phases = {m.state.phase for m in members}
        if phases == {"standby"} and len(moments) < 50:
            moments.append("ready")
            if len(moments) == 20:
                members[1].runner.on_link_event(VehicleRebooted())
            if len(moments) == 50:
                members[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
        return members[0].state.phase == "flying"

    ground.fly(story)
    assert len(moments) == 50
    assert ground.links[0].calls == ["connect", "prepare", "upload", "identify", "launch"]
    assert ground.links[1].calls == ["connect", "prepare", "upload", "prepare", "upload"]


@pytest.mark.parametrize(("count", "who"), [(1, "uav1"), (2, "every vehicle")])
def test_who_holds_its_mission_is_said_and_of_one_by_name(count: int, who: str) -> None:
    ground = Ground(small(simulate={"count": count}), launch="ordered")
    said = f"{who} holds its mission, read back and compared; the order to launch is waited for"
    ground.fly(lambda _: any("holds its mission" in text for _, text in ground.said))
    assert said in [text for _, text in ground.said]


def test_a_vehicle_that_waits_for_its_order_may_fall_silent_for_as_long_as_it_likes() -> None:
    ground = Ground(small(simulate={"count": 2}, flight={"lost_timeout_s": 2.0}), launch="ordered")
    waited: list[str] = []

    def story(members: Sequence[Member]) -> bool:
        if not waited and all(m.state.phase == "standby" for m in members):
            ground.links[0].age = 99.0
            members[0].runner.post(ev.LinkLost(5.0))
        waited.append(members[0].state.phase)
        if len(waited) == 300:
            members[0].runner.post(ev.LinkRestored())
            members[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
        return members[0].state.phase == "flying"

    ground.fly(story)
    assert len(waited) > 300


@pytest.mark.parametrize(("waits_s", "checks"), [(20.0, 1), (40.0, 2)])
@pytest.mark.parametrize("fit", [True, False])
def test_what_was_checked_long_before_the_order_to_launch_is_checked_again(
    waits_s: float, checks: int, fit: bool
) -> None:
    """Its battery has fallen meanwhile, or another station has cleared its fence."""
    verdicts = [[], [] if fit else ["uav1: fence: found 0 corners; wanted 4"]]
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(verdicts))
    standby_s: list[float] = []
    ordered_s: list[float] = []
    trouble: list[str] = []

    def story(members: Sequence[Member]) -> bool:
        state, now = members[0].state, asyncio.get_running_loop().time()
        if state.phase == "standby":
            standby_s.append(now)
            if not ordered_s and now - standby_s[0] >= waits_s:
                members[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
                ordered_s.append(now)
        trouble[:] = [state.trouble]
        return state.phase == "flying" or (bool(ordered_s) and now - ordered_s[0] > 20.0)

    ground.fly(story)
    assert ground.clearance.calls.count(("check", "uav1")) == checks
    is_launched = fit or checks == 1
    assert ("launch" in ground.links[0].calls) == is_launched
    assert ("fence: found 0 corners" in trouble[0]) == (not is_launched)


def test_who_comes_into_the_way_while_a_vehicle_is_checked_for_its_launch_is_waited_for() -> None:
    """Between the order and the arming its checks may take half a minute."""
    scenario = small(simulate={"count": 1}, threats={"count": 0})
    ground = Ground(scenario, launch="ordered", clearance=Clearance(lasts_s=10.0))
    frame, (lat_deg, lon_deg) = scenario.grid.frame, scenario.specs[0].start
    there = frame.to_geodetic(*scenario.grid.centre_m(scenario.tasks[0].goals[0]))
    hovers = IntentShared(1, tuple(IntentPoint(t, *there, 315.0) for t in (0.0, 600.0)))
    ordered_s: list[float] = []
    standby_s: list[float] = []
    launched_s: list[float] = []

    def story(members: Sequence[Member]) -> bool:
        runner, now = members[0].runner, asyncio.get_running_loop().time()
        here = VehicleState(now, lat_deg=lat_deg, lon_deg=lon_deg, alt_rel_m=0.0, alt_amsl_m=300.0)
        runner.on_link_event(StateChanged(replace(here, home_lat_deg=lat_deg, home_lon_deg=lon_deg)))
        if runner.state.phase == "standby" and not standby_s:
            standby_s.append(now)
        if standby_s and not ordered_s and now - standby_s[0] >= 45.0:
            runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
            ordered_s.append(now)
        if ordered_s and 5.0 <= now - ordered_s[0] < 15.0:
            runner.post(ev.Intents(((7, 0.0, hovers),)))
        if "launch" in ground.links[0].calls and not launched_s:
            launched_s.append(now)
        return bool(launched_s)

    ground.fly(story)
    assert ground.clearance.calls.count(("check", "uav1")) >= 2
    # What vehicle 7 has told counts for 20 s.
    assert launched_s[0] - ordered_s[0] >= 34.0


def test_who_was_not_fit_when_it_was_ordered_to_launch_is_checked_again_by_the_next_order() -> None:
    verdicts = [[], ["uav1: battery: found 40 %; wanted 60 %"]]
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(verdicts))
    ordered_s: list[float] = []
    waits_s: list[float] = []

    def story(members: Sequence[Member]) -> bool:
        state, now = members[0].state, asyncio.get_running_loop().time()
        if state.phase == "standby":
            waits_s.append(now)
            if now - [waits_s[0], *ordered_s][-1] >= 40.0:  # what was checked is too old by then
                members[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
                ordered_s.append(now)
        return state.phase == "flying" or state.ended

    ground.fly(story)
    assert len(ordered_s) == 2
    assert ground.links[0].calls.count("launch") == 1


def test_one_that_boots_after_its_launch_was_forbidden_is_made_ready_again() -> None:
    verdicts = [[], ["uav1: battery: found 40 %; wanted 60 %"]]
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(verdicts))
    moments: list[float] = []

    def story(members: Sequence[Member]) -> bool:
        state, now = members[0].state, asyncio.get_running_loop().time()
        if state.phase == "standby":
            moments.append(now)
            if len(moments) == 400:
                members[0].runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
            if len(moments) == 450:
                members[0].runner.on_link_event(VehicleRebooted())
        return len(moments) == 600

    ground.fly(story)
    assert ground.links[0].calls.count("upload") == 2


def test_a_vehicle_that_waits_long_for_its_turn_is_checked_again() -> None:
    ground = Ground(small(simulate={"count": 2, "delay_step_s": 60.0}))

    def worse(members: Sequence[Member]) -> bool:
        if members[0].state.phase == "flying":
            ground.clearance.verdicts = [["uav2: battery: found 12 %"]]
        return members[1].state.ended

    ground.fly(worse)
    assert "launch" in ground.links[0].calls
    assert "launch" not in ground.links[1].calls


def test_a_vehicle_that_boots_while_it_is_checked_again_is_not_launched() -> None:
    ground = Ground(small(simulate={"count": 1}), launch="ordered", clearance=Clearance(lasts_s=10.0))
    begun_s: list[float] = []

    def story(members: Sequence[Member]) -> bool:
        runner, now = members[0].runner, asyncio.get_running_loop().time()
        if runner.is_freshly_cleared or not runner.cleared.is_set():
            return members[0].state.ended or bool(begun_s and now - begun_s[0] > 20.0)
        if not begun_s:
            begun_s.append(now)
            runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH, 1))
        elif 5.0 < now - begun_s[0] < 6.0:
            runner.on_link_event(VehicleRebooted())
        return members[0].state.ended

    ground.fly(story)
    assert begun_s
    assert "launch" not in ground.links[0].calls

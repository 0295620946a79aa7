"""The course of a flight: everyone answers, everyone is ready, everyone holds a mission, then they launch.

Until the launch one vehicle in trouble stops all, because nothing is lost by it; afterwards a vehicle that
fails is reported and the others fly on.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from swarmctl.agent import IN_FLIGHT, ON_GROUND, AgentState, Phase, place_of
from swarmctl.config import Flight
from swarmctl.core import events as ev
from swarmctl.core.geo import distance_m
from swarmctl.core.returns import told, turns_of
from swarmctl.core.vehicle import Landed
from swarmctl.links.base import Identity, LinkError
from swarmctl.runner import Runner
from swarmctl.scenario import Spec
from swarmctl.supervise import cancelled

START_TOLERANCE_M = 100.0
"""A vehicle that stands farther than this from its configured start is not the one that was planned for."""
HOLD_DEADLINE_S = 8.0
WAITING_SAID_EVERY_S = 3.0
POLL_S = 0.1
AGAIN_S = 5.0
"""to the next try, where a vehicle that waits for its order has to be made ready again"""

Launch = Literal["when-ready", "ordered", "never"]
"""ordered: by an operator, whose order goes to the agent; the director sees to it that it can follow. never:
preflight alone; nobody gets the permission to arm"""


class PreflightFailed(Exception):
    """Nothing was armed; one line a vehicle says why."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = tuple(lines)


@dataclass(slots=True)
class Member:
    """A vehicle of the swarm while it is flown."""

    spec: Spec
    runner: Runner
    identity: Identity | None = None
    waiting_for: tuple[str, ...] = ()

    @property
    def state(self) -> AgentState:
        return self.runner.state

    @property
    def name(self) -> str:
        return self.spec.name

    def silent_for(self, limit_s: float) -> bool:
        return self.state.lost and self.runner.link.age_s() > limit_s


Permission = Callable[[Sequence[Member]], None]
"""Called with the vehicles that the built-in simulator does not play; raises PreflightFailed to forbid."""


class Clearance(Protocol):
    """Preflight checks; nothing of them arms."""

    async def set_up(self, subject: Member) -> None:
        """Before a vehicle is made ready. Raises LinkError."""

    async def failures(self, subjects: Sequence[Member], everyone: Sequence[Member]) -> list[str]:
        """Of vehicles that have answered, a line for each check that forbids arming."""


class Director:
    """Leads the members through one flight. `stop` asks for an early, orderly end."""

    def __init__(
        self,
        members: Sequence[Member],
        flight: Flight,
        *,
        seconds_per_delay: float,
        say: Callable[[str], None],
        permission: Permission,
        clearance: Clearance,
        launch: Launch = "when-ready",
    ) -> None:
        self._members = members
        self._flight = flight
        self._seconds_per_delay = seconds_per_delay
        self._say = say
        self._permission = permission
        self._clearance = clearance
        self._when_ready = launch == "when-ready"
        self._checks_only = launch == "never"
        self.stop = asyncio.Event()

    async def fly(self) -> Literal["ended", "stopped"]:
        """From the first heartbeat to the last landing. Raises PreflightFailed before anything is armed."""
        flight = asyncio.create_task(self._fly())
        stop = asyncio.create_task(self.stop.wait())
        try:
            await asyncio.wait((flight, stop), return_when=asyncio.FIRST_COMPLETED)
            if flight.done():
                flight.result()
                return "ended"
        finally:
            await cancelled(flight, stop)
        await self._leave()
        return "stopped"

    async def _fly(self) -> None:
        await self._all(self._connect)
        if self._checks_only:
            self._foreigners()
            await self._prepare_all()
            return
        self._permit()
        await self._prepare_all()
        next_step = "launching" if self._when_ready else "the order to launch is waited for"
        self._say(f"every vehicle holds its mission, read back and compared; {next_step}")
        async with asyncio.TaskGroup() as launches:
            for member in self._members:
                launches.create_task(self._launch(member))
        await self._until(self._is_over, self._members)

    async def _prepare_all(self) -> None:
        """Set up, ready, with a mission, checked. Raises PreflightFailed with all that is wrong."""
        failures: list[str] = []
        for step in (self._clearance.set_up, self._make_ready):
            try:
                await self._all(step)
            except PreflightFailed as failed:
                failures += failed.lines
        try:
            await self._clear(self._members)
        except PreflightFailed as failed:
            failures += failed.lines
        failures += [left_how(m) for m in self._members if m.state.lost]
        if failures:
            raise PreflightFailed(list(dict.fromkeys(failures)))

    async def _clear(self, members: Sequence[Member]) -> None:
        """The checks without which none of them may be launched; all that fail in one report."""
        failures = await self._clearance.failures(members, self._members)
        if failures:
            raise PreflightFailed(failures)
        for member in members:
            member.runner.cleared.set()

    async def _prepare_again(self, member: Member) -> None:
        """One that may have booted meanwhile: then all of it anew."""
        if not member.runner.cleared.is_set():
            await self._clearance.set_up(member)
        await self._make_ready(member)
        if not member.runner.cleared.is_set() and not member.state.ended:
            await self._clear([member])

    def _permit(self) -> None:
        """Who each vehicle is decides what it may be sent from here on. Raises PreflightFailed."""
        foreign = self._foreigners()
        if foreign:
            self._permission(foreign)
        for member in self._members:
            member.runner.armable = member.identity

    def _foreigners(self) -> list[Member]:
        """Those that the built-in simulator does not play. Raises PreflightFailed where one is in its place,
        or where two share an address."""
        rivals = [m for m in self._members if m.runner.conflict]
        if rivals:
            raise PreflightFailed([f"{m.name}: {m.runner.conflict}; give each its own" for m in rivals])
        foreign = [m for m in self._members if m.identity is None or not m.identity.simulated]
        impostors = [m for m in foreign if m.spec.simulated]
        if impostors:
            raise PreflightFailed([_impostor(m) for m in impostors])
        return foreign

    async def _all(self, act: Callable[[Member], Coroutine[None, None, None]]) -> None:
        """One preflight step on every member at once; all failures in one report."""
        outcomes = await asyncio.gather(*map(act, self._members), return_exceptions=True)
        for outcome in outcomes:
            if isinstance(outcome, BaseException) and not isinstance(outcome, (LinkError, PreflightFailed)):
                raise outcome
        failures = [str(o) for o in outcomes if isinstance(o, Exception)]
        if failures:
            raise PreflightFailed(failures)

    async def _connect(self, member: Member) -> None:
        member.identity = await member.runner.link.connect(self._flight.connect_timeout_s)
        self._say(f"{member.name}: system {member.identity.sysid} answers, {member.identity.firmware}")

    async def _make_ready(self, member: Member) -> None:
        """Until it holds a verified mission; begins again where it boots anew meanwhile."""
        while not (member.state.phase is Phase.STANDBY or member.state.ended):
            await self._prepare(member)
            member.runner.post(ev.Ready())
            await self._until(lambda m: m.state.phase is not Phase.WAITING or m.state.lost, [member])
            await self._until(lambda m: m.state.phase is not Phase.UPLOADING or m.state.lost, [member])
            if member.state.lost:
                break
        if member.state.ended:
            raise PreflightFailed([f"{member.name}: {member.state.outcome}"])
        if member.state.lost:
            raise PreflightFailed([left_how(member)])

    async def _prepare(self, member: Member) -> None:
        clock = asyncio.get_running_loop().time
        said_s = clock()

        def waiting(reasons: tuple[str, ...]) -> None:
            nonlocal said_s
            member.waiting_for = reasons
            # The first seconds bring a new list with every message; what stays is worth a line.
            if reasons and clock() - said_s >= WAITING_SAID_EVERY_S:
                said_s = clock()
                self._say(f"{member.name} is not ready: {'; '.join(reasons)}")

        await member.runner.link.prepare(self._flight.ready_timeout_s, waiting)
        member.waiting_for = ()
        where = member.runner.link.state()
        if where.lat_deg is None or where.lon_deg is None:
            raise PreflightFailed([f"{member.name}: it says it is ready but has told no position"])
        away_m = distance_m((where.lat_deg, where.lon_deg), member.spec.start)
        if away_m > START_TOLERANCE_M:
            raise PreflightFailed([_misplaced(member, away_m)])

    async def _launch(self, member: Member) -> None:
        if self._when_ready:
            await self._launch_when_ready(member)
        await self._stand_by(member)

    async def _launch_when_ready(self, member: Member) -> None:
        """After its delay, during which it may have booted anew, fallen silent, or been taken over."""
        await asyncio.sleep(member.spec.delay_s * self._seconds_per_delay)
        try:
            await self._prepare_again(member)
        except (LinkError, PreflightFailed) as error:
            self._say(f"{error}; it stays on the ground")
            member.runner.post(ev.OperatorCommand(ev.Order.HOLD))
            return
        member.runner.post(ev.OperatorCommand(ev.Order.LAUNCH))

    async def _stand_by(self, member: Member) -> None:
        """As long as it is on the ground, where an operator may keep it: ready for the order to launch."""
        while member.state.phase in ON_GROUND and not (self._when_ready and self._is_over(member)):
            if member.state.lost or not _wants_preparing(member):
                await asyncio.sleep(POLL_S)
                continue
            try:
                await self._prepare_again(member)
            except (LinkError, PreflightFailed) as error:
                if not member.state.ended:
                    self._say(f"{error}; tried again in {AGAIN_S:g} s")
                    await asyncio.sleep(AGAIN_S)

    def _is_over(self, member: Member) -> bool:
        return member.state.ended or member.silent_for(self._flight.lost_timeout_s)

    async def _leave(self) -> None:
        """Hold all, then what the configuration says, within its deadline."""
        in_flight = [
            m for m in self._members if m.state.phase in IN_FLIGHT or m.state.phase is Phase.LAUNCHING
        ]
        order = ev.Order(self._flight.on_exit)
        # Who returns already is not stopped on its way, only to be sent home again.
        on_its_way = [m for m in in_flight if order is ev.Order.RETURN and m.state.phase is Phase.LEAVING]
        stopped = [m for m in in_flight if m not in on_its_way]
        self._say(f"stopping: {_names(stopped) or 'no vehicle'} in flight to hold")
        self._order([m for m in self._members if m not in on_its_way], ev.Order.HOLD)
        await self._within(HOLD_DEADLINE_S, _holds, stopped)
        if order is ev.Order.HOLD:
            return
        flying = [m for m in in_flight if not m.state.ended]
        self._say(f"{_names(flying) or 'no vehicle'} to {order}")
        self._order(flying, order)
        await self._within(self._flight.on_exit_deadline_s, lambda m: m.state.ended, flying)
        late = [m for m in flying if m.state.turn_boot_s is not None]
        if late:
            self._say(f"{_names(late)} to return now, whoever else is in the air")
            for member in late:
                member.runner.post(ev.OperatorCommand(ev.Order.RETURN))
            await self._within(HOLD_DEADLINE_S, _returns, late)

    def _order(self, members: Iterable[Member], order: ev.Order) -> None:
        members = list(members)
        called = [m.spec.sysid for m in members] if order is ev.Order.RETURN else []
        turns = turns_to_return(self._members, self._say, called)
        for member in members:
            after_s = turns.get(member.spec.sysid, 0.0)
            member.runner.post(ev.OperatorCommand(order, after_s=after_s))

    async def _within(
        self, deadline_s: float, condition: Callable[[Member], bool], members: Sequence[Member]
    ) -> None:
        try:
            async with asyncio.timeout(deadline_s):
                await self._until(condition, members)
        except TimeoutError:
            late = [m for m in members if not condition(m)]
            self._say(f"not within {deadline_s:g} s: {_names(late)}")

    async def _until(self, condition: Callable[[Member], bool], members: Sequence[Member]) -> None:
        # Looked at a few times a second: silence, unlike a change of phase, wakes nobody.
        while not all(condition(m) for m in members):  # noqa: ASYNC110
            await asyncio.sleep(POLL_S)


def _wants_preparing(member: Member) -> bool:
    phase = member.state.phase
    return phase is Phase.WAITING or (phase is Phase.STANDBY and not member.runner.cleared.is_set())


def _holds(member: Member) -> bool:
    """It follows the order to hold, or has something better to do: it is down, or on its way down."""
    state = member.state
    return (state.phase is Phase.HOLDING and state.order_seen) or state.ended or state.launch_aborted


def _returns(member: Member) -> bool:
    """It follows the order to return, and waits for no turn; or it is over."""
    state = member.state
    return state.ended or (state.turn_boot_s is None and state.order_seen)


def turns_to_return(
    members: Sequence[Member], say: Callable[[str], None], uavs: Sequence[int]
) -> Mapping[int, float]:
    """How long each of these waits for its turn [s], by system id; who waits is said."""
    called = [m for m in members if m.spec.sysid in uavs or m.state.phase is Phase.LEAVING]
    places = {m.spec.sysid: place_of(m.state) for m in called}
    turns = turns_of({uav: place for uav, place in places.items() if place is not None})
    if any(turns.begins_s.values()) or turns.not_apart:
        say(f"returning: {told(turns, {m.spec.sysid: m.name for m in called})}")
    # Nobody knows where the others are: they come when all else is down.
    return {uav: turns.begins_s.get(uav, turns.down_s) for uav in uavs}


def left_how(member: Member) -> str:
    """How a vehicle was left, for whoever has to fetch it."""
    state, vehicle = member.state, member.runner.link.state()
    age_s = member.runner.link.age_s()
    if age_s == float("inf"):
        return f"{member.name}: never heard"
    if state.lost:
        return f"{member.name}: lost, last heard {age_s:.0f} s ago in mode {vehicle.mode or '?'}"
    if state.ended and not vehicle.armed and state.outcome:
        return f"{member.name}: {state.outcome}"
    if not vehicle.armed:
        return f"{member.name}: on the ground, disarmed"
    height = "at unknown height" if vehicle.alt_rel_m is None else f"{vehicle.alt_rel_m:.0f} m above home"
    where = "armed on the ground" if vehicle.landed is Landed.ON_GROUND else f"in the air, {height}"
    how = state.outcome or state.trouble or state.phase
    if state.phase in (Phase.HOLDING, Phase.LEAVING) and not state.order_seen:
        how = f"{how}, not seen to follow"
    return f"{member.name}: {where}, mode {vehicle.mode or '?'} ({how})"


def _names(members: Sequence[Member]) -> str:
    return ", ".join(m.name for m in members)


def _impostor(member: Member) -> str:
    found = member.identity.firmware if member.identity is not None else "nothing known"
    return (
        f"{member.name}: expected a vehicle of the built-in simulator at {member.spec.url}, system "
        f"{member.spec.sysid}, found {found}; another autopilot sends to this port: stop it, or list it "
        "under `vehicles` and fly with --real"
    )


def _misplaced(member: Member, away_m: float) -> str:
    lat_deg, lon_deg = member.spec.start
    return (
        f"{member.name}: it stands {away_m:.0f} m from its configured start ({lat_deg:.6f}, {lon_deg:.6f}), "
        f"expected at most {START_TOLERANCE_M:g} m; correct `start`, or carry it there"
    )

"""The course of a flight: everyone answers, everyone is ready, everyone holds a mission, then they launch.

Until the launch one vehicle in trouble stops all, because nothing is lost by it; afterwards a vehicle that
fails is reported and the others fly on.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from typing import Literal, Protocol

from swarmctl.agent.state import IN_FLIGHT, ON_GROUND, Phase
from swarmctl.config.model import FlightSection
from swarmctl.core import events as ev
from swarmctl.core.geo import distance_m
from swarmctl.flight.member import POLL_S, Member, names, until
from swarmctl.flight.shutdown import Shutdown, Elsewhere
from swarmctl.flight.supervise import cancelled
from swarmctl.links.base import LinkError
from swarmctl.report.final_state import FlightEnd, is_released_in_air, describe_final_state

START_TOLERANCE_M = 100.0
"""A vehicle that stands farther than this from its configured start is not the one that was planned for."""
WAITING_SAID_EVERY_S = 3.0
KNOWN_WITHIN_S = 10.0
"""to find what is known, where preflight is stopped"""
EARLY_S = 3.0
"""After this somebody who is ready is looked at, while others are still waited for."""
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


Permission = Callable[[Sequence[Member]], None]
"""Called with the vehicles that the built-in simulator does not play; raises PreflightFailed to forbid."""


class Clearance(Protocol):
    """Preflight checks; nothing of them arms."""

    async def set_up(self, subject: Member) -> None:
        """Before a vehicle is made ready. Raises LinkError."""

    async def failures(self, subjects: Sequence[Member], everyone: Sequence[Member]) -> list[str]:
        """Of vehicles that have answered, a line for each check that forbids arming."""

    async def found_early(self, subject: Member, everyone: Sequence[Member]) -> list[str]:
        """As `failures`, of one that is ready while others are not: what is to be said of it now."""


class Director:
    """Leads the members through one flight. `stop` asks for an early, orderly end."""

    def __init__(
        self,
        members: Sequence[Member],
        flight: FlightSection,
        *,
        seconds_per_delay: float,
        say: Callable[[str], None],
        permission: Permission,
        clearance: Clearance,
        launch: Launch = "when-ready",
        elsewhere: Elsewhere | None = None,
    ) -> None:
        """`elsewhere`: what others do that are not flown by this process, of which it flies one."""
        self._members = members
        self._flight = flight
        self._seconds_per_delay = seconds_per_delay
        self._say = say
        self._permission = permission
        self._clearance = clearance
        self._when_ready = launch == "when-ready"
        self._checks_only = launch == "never"
        self._elsewhere = elsewhere
        self.stop = asyncio.Event()

    @property
    def on_ctrl_c(self) -> str:
        """What asking for the end does now, in words."""
        if self.stop.is_set():
            return "leave at once"
        if any(m.state.phase in IN_FLIGHT or m.state.phase is Phase.LAUNCHING for m in self._members):
            order = self._flight.on_exit
            return "hold, and leave them there" if order == "hold" else f"hold, then {order}"
        let_go = any(is_released_in_air(m.state) for m in self._members)
        return "leave who was let go in the air" if let_go else "leave"

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
        if self._checks_only:
            await self._find_what_is_known()
        else:
            await Shutdown(self._members, self._flight, self._say, self._elsewhere).leave()
        return "stopped"

    async def _find_what_is_known(self) -> None:
        """The checks of those that have answered, as they stand."""
        answered = [m for m in self._members if m.identity is not None]
        for member in answered:
            member.not_ready_because = member.not_ready_because or "; ".join(member.waiting_for)
        self._say(f"stopping; what is known of {names(answered) or 'nobody'} is looked at once more")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(KNOWN_WITHIN_S):
                await self._clearance.failures(answered, answered)

    async def _fly(self) -> None:
        await self._all(self._connect)
        if self._checks_only:
            self._foreigners()
            await self._prepare_all()
            return
        self._permit()
        await self._prepare_all()
        next_step = "launching" if self._when_ready else "the order to launch is waited for"
        self._say(f"{self._who_holds_what()}; {next_step}")
        async with asyncio.TaskGroup() as launches:
            for member in self._members:
                launches.create_task(self._launch(member))
        seen = FlightEnd(self._members, self._flight.lost_timeout_s, self._say)
        while not seen.all_over():  # noqa: ASYNC110 - silence wakes nobody
            await asyncio.sleep(POLL_S)

    def _who_holds_what(self) -> str:
        theirs = [m for m in self._members if self._is_theirs(m)]
        if len(theirs) == len(self._members):
            return f"somebody else has {names(theirs)}"
        who = "every vehicle" if len(self._members) > 1 else names(self._members)
        besides = f" but {names(theirs)}, which somebody else has" if theirs else ""
        return f"{who} holds its mission, read back and compared{besides}"

    async def _prepare_all(self) -> None:
        """Set up, ready, with a mission, checked. Raises PreflightFailed with all that is wrong."""
        failures: list[str] = []
        for step in (self._clearance.set_up, self._make_ready):
            try:
                await self._all_heard(step)
            except PreflightFailed as failed:
                failures += failed.lines
        ours = [m for m in self._members if not self._is_theirs(m)]
        try:
            await self._clear(ours)
        except PreflightFailed as failed:
            failures += failed.lines
        # Also who was ready, and has been taken over since.
        failures += [f"{m.name}: {m.state.outcome}" for m in ours if m.state.ended]
        failures += [describe_final_state(m) for m in ours if m.state.lost]
        if failures:
            raise PreflightFailed(list(dict.fromkeys(failures)))

    def _is_theirs(self, member: Member) -> bool:
        """Somebody else has armed it: the others fly without it, and link and heartbeat stay with it. Checks
        alone let nobody pass for that."""
        return not self._checks_only and member.state.phase is Phase.RELEASED

    async def _clear(self, members: Sequence[Member]) -> None:
        """The checks without which none of them may be launched; all that fail in one report."""
        failures = await self._clearance.failures(members, self._members)
        if failures:
            raise PreflightFailed(failures)
        for member in members:
            member.runner.clear()

    async def _prepare_again(self, member: Member) -> None:
        """One that may have booted meanwhile: then all of it anew. What was checked long ago is, too."""
        if not member.runner.cleared.is_set():
            await self._clearance.set_up(member)
        await self._make_ready(member)
        if not member.runner.is_freshly_cleared and not member.state.ended:
            await self._clear([member])

    def _permit(self) -> None:
        """Who each vehicle is decides what it may be sent from here on. Raises PreflightFailed."""
        foreign = self._foreigners()
        if foreign:
            self._permission(foreign)
        for member in self._members:
            member.runner.armable = member.identity
            member.runner.check_again = partial(self._clearance.failures, [member], self._members)

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

    async def _all_heard(self, act: Callable[[Member], Coroutine[None, None, None]]) -> None:
        """`_all`, and what is wrong with some is said as soon as it is known, though others take longer."""
        under_way = {m.name for m in self._members if not self._is_theirs(m)}

        async def heard(member: Member) -> None:
            try:
                await act(member)
            except (LinkError, PreflightFailed) as error:
                if under_way - {member.name} and not self._is_theirs(member):
                    self._say(f"{error}; the others are waited for")
                raise
            finally:
                under_way.discard(member.name)

        telling = asyncio.create_task(self._tell_early())
        try:
            await self._all(heard)
        finally:
            await cancelled(telling)

    async def _tell_early(self) -> None:
        """What is found of those who are ready, each once; the checks that count come when all are."""
        left = {m.name: m for m in self._members}
        while left:
            await asyncio.sleep(EARLY_S)
            for member in [m for m in left.values() if m.state.phase is Phase.STANDBY]:
                del left[member.name]
                for text in await self._clearance.found_early(member, self._members):
                    self._say(f"{text}; the others are waited for")

    async def _all(self, act: Callable[[Member], Coroutine[None, None, None]]) -> None:
        """One preflight step on every member at once; all failures in one report. Of who was taken over
        meanwhile that is told already, and no failure of the others."""
        members = [m for m in self._members if not self._is_theirs(m)]
        outcomes: list[BaseException | None]
        outcomes = await asyncio.gather(*map(act, members), return_exceptions=True)
        for i, (member, outcome) in enumerate(zip(members, outcomes, strict=True)):
            if isinstance(outcome, BaseException) and not isinstance(outcome, (LinkError, PreflightFailed)):
                raise outcome
            if self._is_theirs(member):
                outcomes[i] = None
            elif outcome is not None:
                reasons = "; ".join(member.waiting_for)
                member.not_ready_because = reasons or str(outcome).removeprefix(f"{member.name}: ")
        failures = [str(o) for o in outcomes if isinstance(o, Exception)]
        if failures:
            raise PreflightFailed(failures)

    async def _connect(self, member: Member) -> None:
        member.identity = await member.runner.link.connect(self._flight.connect_timeout_s)
        self._say(f"{member.name}: system {member.identity.sysid} answers, {member.identity.firmware}")
        found = member.runner.link.state()
        if found.armed:
            text = f"it is armed already, in mode {found.mode or '?'}; land and disarm it, or leave it out"
            raise PreflightFailed([f"{member.name}: {text}"])

    async def _make_ready(self, member: Member) -> None:
        """Until it holds a verified mission; begins again where it boots anew meanwhile."""
        while not (member.state.phase is Phase.STANDBY or member.state.ended):
            await self._prepare(member)
            member.runner.post(ev.Ready())
            await until(lambda m: m.state.phase is not Phase.WAITING or m.state.lost, [member])
            await until(lambda m: m.state.phase is not Phase.UPLOADING or m.state.lost, [member])
            if member.state.lost:
                break
        if member.state.ended:
            raise PreflightFailed([f"{member.name}: {member.state.outcome}"])
        if member.state.lost:
            raise PreflightFailed([describe_final_state(member)])

    async def _prepare(self, member: Member) -> None:
        clock = asyncio.get_running_loop().time
        said_s = clock()

        def waiting(reasons: tuple[str, ...]) -> None:
            nonlocal said_s
            member.waiting_for = reasons
            # The first seconds bring a new list with every message; what stays is worth a line.
            if reasons and clock() - said_s >= WAITING_SAID_EVERY_S:
                said_s = clock()
                self._say(
                    f"{member.name} is not ready: {'; '.join(reasons)} (waited for "
                    f"{self._flight.ready_timeout_s:g} s at most)"
                )

        await member.runner.link.prepare(self._flight.ready_timeout_s, waiting)
        member.waiting_for, member.not_ready_because = (), ""
        where = member.runner.link.state()
        if where.lat_deg is None or where.lon_deg is None:
            raise PreflightFailed([f"{member.name}: it says it is ready but has told no position"])
        away_m = distance_m((where.lat_deg, where.lon_deg), member.spec.start)
        if away_m > START_TOLERANCE_M:
            raise PreflightFailed([_misplaced(member, away_m)])

    async def _launch(self, member: Member) -> None:
        if self._is_theirs(member):
            return
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
            member.runner.post(ev.OperatorCommand(ev.FlightOrder.HOLD))
            return
        member.runner.post(ev.OperatorCommand(ev.FlightOrder.LAUNCH))

    async def _stand_by(self, member: Member) -> None:
        """As long as it is on the ground, where an operator may keep it: ready for the order to launch."""
        # One that is told to launch and may not stands by again.
        standing = ON_GROUND | {Phase.LAUNCHING}
        while member.state.phase in standing and not (self._when_ready and self._is_over(member)):
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


def _wants_preparing(member: Member) -> bool:
    phase = member.state.phase
    return phase is Phase.WAITING or (phase is Phase.STANDBY and not member.runner.cleared.is_set())


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

"""The I/O shell of one agent: what the link, the sensor and the bus report goes in, effects come out.

The runner alone performs effects, and feeds how they ended back as events. It decides nothing.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from functools import partial
from typing import Any, Protocol

from swarmctl.agent.state import ON_GROUND, AgentState, Task, begin
from swarmctl.agent.step import step, wants_tick
from swarmctl.agent.traffic.launching import in_the_way
from swarmctl.agent.traffic.neighbours import concerns
from swarmctl.bus.network import Network
from swarmctl.bus.operator_service import Desk
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.frames import IntentShared, Spoken, StateShared
from swarmctl.core.observation import Told
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.supervise import Backoff, retrying
from swarmctl.links.base import (
    AddressChanged,
    Conflict,
    FramesRefused,
    Heard,
    Identity,
    LaunchPutOff,
    Link,
    LinkError,
    LinkEvent,
    Lost,
    ProcedureDone,
    Rebooted,
    Restored,
    StateChanged,
    SwapFailed,
    Text,
    UploadFailed,
)

UPLOADS = Backoff(attempts=3, first_s=2.0)
IDENTIFY_TIMEOUT_S = 15.0
LOOK_EVERY_S = 0.5
"""for others, by the vehicle's clock"""
CLEARANCE_TIMEOUT_S = 30.0
"""given to preflight checks that are still under way when the launch is ordered"""
CLEARANCE_LASTS_S = 30.0
"""Batteries fall, and other stations change fences: what was found longer ago is looked at again."""


class Sensor(Protocol):
    def look(self, vehicle: VehicleState) -> tuple[tuple[int, int, bool], ...]: ...


class Observer(Protocol):
    """Whoever wants to know what happens: recorder, summary."""

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None: ...

    def sent(self, uav: int, message: Spoken, recipients: int, now: float) -> None: ...

    def said(self, uav: int, text: str, now: float, *, aloud: bool) -> None: ...


class NotAllowed(RuntimeError):
    """A launch nobody allowed reached the runner: a bug, and the last barrier before a real aircraft arms."""


class Runner:
    """One vehicle, from its mission on the ground to its landing. Use `run` as a task of its own."""

    def __init__(
        self,
        task: Task,
        prior: Belief,
        link: Link,
        sensor: Sensor,
        network: Network,
        observers: tuple[Observer, ...],
        *,
        desk: Desk | None = None,
        offload: bool = False,
    ) -> None:
        self.state = begin(task, prior)
        self.link = link
        self.armable: Identity | None = None
        """whom permission was given to arm; nobody else is launched at this address"""
        self.cleared = asyncio.Event()
        """its preflight checks are passed, since its last boot; until then its launch waits"""
        self.check_again: Callable[[], Awaitable[Sequence[str]]] | None = None
        """goes through its preflight checks once more: a line for each that forbids to arm it"""
        self._cleared_s = -math.inf
        self.conflict = ""
        """another sender uses its system id"""
        self._sensor = sensor
        self._network = network
        self._observers = observers
        self._desk = desk
        self._offload = offload
        self._inbox: deque[ev.Event] = deque()
        self._wake = asyncio.Event()
        self._job: asyncio.Task[None] | None = None
        self._ending: set[asyncio.Task[None]] = set()
        """earlier ones, cancelled; the job waits for their ends"""
        self._looked_s = -math.inf
        self._seen: dict[int, StateShared] = {}
        self._intents: dict[int, IntentShared] = {}
        """of others, as they were handed over"""
        self._told: list[Told] = []
        """heard of others and not folded yet"""
        self.post(ev.Joined(network.join(task.uav, self._hear)))
        if desk is not None:
            desk.join(task.uav, task.name, self.post)

    def clear(self) -> None:
        """Its preflight checks are passed, now."""
        self._cleared_s = asyncio.get_running_loop().time()
        self.cleared.set()

    @property
    def is_freshly_cleared(self) -> bool:
        age_s = asyncio.get_running_loop().time() - self._cleared_s
        return self.cleared.is_set() and age_s <= CLEARANCE_LASTS_S

    def post(self, event: ev.Event) -> None:
        """Hand over an event; it is folded in its turn."""
        self._inbox.append(event)
        self._wake.set()

    def _hear(self, told: tuple[Told, ...]) -> None:
        self._told += told
        self._wake.set()

    def on_link_event(self, event: LinkEvent) -> None:
        """What the link reports, as events of the agent. Called from the receive path: only appends."""
        match event:
            case StateChanged(state):
                if state.lat_deg is not None and state.lon_deg is not None:
                    self._network.moved(self.state.task.uav, state.lat_deg, state.lon_deg)
                self.post(ev.TelemetryReceived(state))
                self._look_around(state.time_boot_s)
                if cells := self._sensor.look(state):
                    self.post(ev.Observed(cells))
            case Lost(age_s):
                self.post(ev.LinkLost(age_s))
            case Restored():
                self.post(ev.LinkRestored())
            case Rebooted():
                self.cleared.clear()
                self.post(ev.Rebooted())
                self.tell("it has rebooted", aloud=True)
            case Conflict(address):
                self.conflict = f"another sender, at {address}, uses its system id {self.state.task.uav}"
                self.tell(f"{self.conflict}; its frames are dropped", aloud=True)
            case FramesRefused(text):
                self.tell(text, aloud=True)
            case AddressChanged(address):
                self.tell(f"speaks from {address} now", aloud=True)
            case Text(_, text):
                self.tell(text)
            case ProcedureDone(name, failure, stood_still_s):
                stood = "" if stood_still_s is None else f"; stood still for {stood_still_s:.1f} s"
                self.tell(f"{name}: {failure or 'done'}{stood}")
            case Heard():
                self.tell("first heartbeat")

    def _look_around(self, boot_s: float) -> None:
        """What others near it have told since."""
        if 0.0 <= boot_s - self._looked_s < LOOK_EVERY_S:
            return
        self._looked_s = boot_s
        told = self._network.states(self.state.task.uav)
        new = {uav: state for uav, state in told.items() if state is not self._seen.get(uav)}
        self._seen = told
        if near := tuple((uav, state) for uav, state in new.items() if concerns(self.state, uav, state)):
            self.post(ev.Neighbours(near))
        intents = self._network.intents(self.state.task.uav)
        changed = [uav for uav, (intent, _) in intents.items() if intent is not self._intents.get(uav)]
        if changed:
            self._intents = {uav: intent for uav, (intent, _) in intents.items()}
            self.post(ev.Intents(tuple((uav, intents[uav][1], intents[uav][0]) for uav in changed)))

    async def run(self) -> None:
        """Fold events until cancelled. The jobs it starts end with it."""
        async with asyncio.TaskGroup() as jobs:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._inbox or self._told:
                    if self._told:
                        # All that was heard meanwhile is one event: a union costs what one observation does.
                        told, self._told = tuple(self._told), []
                        await self._fold(ev.Heard(told), jobs)
                    if self._inbox:
                        await self._fold(self._inbox.popleft(), jobs)
                if wants_tick(self.state, asyncio.get_running_loop().time()):
                    await self._fold(ev.Tick(), jobs)

    async def _fold(self, event: ev.Event, jobs: asyncio.TaskGroup) -> None:
        now = asyncio.get_running_loop().time()
        before = self.state
        if self._offload and isinstance(event, ev.Tick):
            # A search over a large area holds no GIL; the loop serves the other vehicles meanwhile.
            self.state, effects = await asyncio.to_thread(step, before, event, now)
        else:
            self.state, effects = step(before, event, now)
        for observer in self._observers:
            observer.folded(before, event, self.state, effects, now)
        for effect in effects:
            self._perform(effect, jobs)

    def _perform(self, effect: ev.Effect, jobs: asyncio.TaskGroup) -> None:
        match effect:
            case ev.Publish(message, against):
                recipients = self._network.publish(self.state.task.uav, message, frozenset(against))
                now = asyncio.get_running_loop().time()
                for observer in self._observers:
                    observer.sent(self.state.task.uav, message, recipients, now)
            case ev.SwapMission():
                self._start(partial(self._swap, effect), jobs)
            case ev.Command(order, by_person):
                self._start(partial(self._order, order, looks_first=not by_person), jobs)
            case ev.SetSpeed(speed_m_s):
                self._start(partial(self._set_speed, speed_m_s), jobs)
            case ev.Release():
                self._end_job()
            case ev.Tell(text):
                self.tell(text, aloud=True)
            case ev.Answer(command, answer):
                if self._desk is not None:
                    self._desk.answered(command, answer)

    def _start(self, work: Callable[[], Awaitable[None]], jobs: asyncio.TaskGroup) -> None:
        """One job at a time: what runs is cancelled at once, and has ended before the next begins.

        At once, and by who starts the next: a job that is itself replaced before its first step does nothing.
        """
        self._end_job()
        before = frozenset(self._ending)

        async def job() -> None:
            if before:
                await asyncio.wait(before)
            await work()

        self._job = jobs.create_task(job())

    def _end_job(self) -> None:
        """Cancelled once: how it ends may itself take time."""
        self._ending = {job for job in self._ending if not job.done()}
        if self._job is not None and not self._job.done():
            self._job.cancel()
            self._ending.add(self._job)
        self._job = None

    async def _swap(self, swap: ev.SwapMission) -> None:
        on_ground = self.state.phase in ON_GROUND
        accepted = ev.MissionAccepted(swap.plan_id)
        try:
            if on_ground:
                takes_s = await retrying(lambda: self.link.upload(swap.plan), UPLOADS, UploadFailed)
                accepted = ev.MissionAccepted(swap.plan_id, takes_s)
            else:
                done = await self.link.swap(swap.plan)
                accepted = ev.MissionAccepted(swap.plan_id, done.took_s, done.stood_still_s)
        except SwapFailed as error:
            failed = ev.MissionFailed(
                swap.plan_id, error.flying, str(error), error.stood_still_s, error.is_late
            )
            self.post(failed)
        except LinkError as error:
            self.post(ev.MissionFailed(swap.plan_id, "unknown", str(error)))
        else:
            self.post(accepted)

    async def _set_speed(self, speed_m_s: float) -> None:
        try:
            await self.link.set_speed(speed_m_s)
        except LinkError as error:
            self.post(ev.SpeedFailed(str(error)))

    async def _order(self, order: ev.Order, *, looks_first: bool) -> None:
        if order is ev.Order.LAUNCH and (why := await self._forbidden()):
            self.post(ev.OrderFailed(order, why, nothing_sent=True))
            return
        actions: dict[ev.Order, Callable[[], Coroutine[Any, Any, None]]] = {
            ev.Order.LAUNCH: partial(self.link.launch, lambda: in_the_way(self.state)),
            ev.Order.HOLD: partial(self.link.hold, looks_first=looks_first),
            ev.Order.RETURN: partial(self.link.return_home, looks_first=looks_first),
            ev.Order.LAND: partial(self.link.land, looks_first=looks_first),
        }
        try:
            await actions[order]()
        except LaunchPutOff as error:
            self.post(ev.LaunchPutOff(error.why, error.was_armed))
        except LinkError as error:
            self.post(ev.OrderFailed(order, str(error)))
        else:
            self.post(ev.OrderDone(order))

    async def _forbidden(self) -> str:
        """Why it is not to be armed now; empty where it is. Nothing of a launch is sent before that."""
        try:
            await self._check_launch()
        except LinkError as error:
            return str(error)
        return ""

    async def _check_launch(self) -> None:
        """Raises LinkError where it may not be armed now."""
        if self.armable is None:
            raise NotAllowed(f"{self.state.task.name}: launch without permission to arm")
        try:
            async with asyncio.timeout(CLEARANCE_TIMEOUT_S):
                await self.cleared.wait()
        except TimeoutError:
            text = "its preflight checks are not passed, see what they say; not launched"
            raise LinkError(f"{self.state.task.name}: {text}") from None
        if not self.is_freshly_cleared:
            await self._clear_again()
        found = await self.link.identify(IDENTIFY_TIMEOUT_S)
        if found != self.armable:
            raise LinkError(
                f"{self.state.task.name}: another vehicle answers than the one that may be armed: "
                f"expected {_identity(self.armable)}, found {_identity(found)}"
            )

    async def _clear_again(self) -> None:
        """Raises LinkError where it is not fit any more."""
        name = self.state.task.name
        if self.check_again is None:
            raise LinkError(f"{name}: its checks are too old, and nobody does them again; not launched")
        failures = await self.check_again()
        if failures:
            raise LinkError("; ".join(failures))
        if not self.cleared.is_set():
            raise LinkError(f"{name}: it has rebooted while it was checked; not launched")
        self.clear()

    def tell(self, text: str, *, aloud: bool = False) -> None:
        """Whoever follows this vehicle is told."""
        now = asyncio.get_running_loop().time()
        for observer in self._observers:
            observer.said(self.state.task.uav, text, now, aloud=aloud)


def _identity(identity: Identity) -> str:
    return f"{identity.firmware}, uid {identity.uid2.hex()}"

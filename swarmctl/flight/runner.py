"""The I/O shell of one agent.

Reports of link, sensor and bus become events of the agent. The runner performs the agent's effects, and
returns their outcomes as events. The agent makes all decisions except the last check before arming
(`ArmingClearance`).
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from functools import partial

from swarmctl.agent.phases import ON_GROUND
from swarmctl.agent.replan.mission_changes import needs_tick
from swarmctl.agent.state import AgentState, Task, initial_state
from swarmctl.agent.step import step
from swarmctl.agent.traffic.neighbours import relevant_states
from swarmctl.bus.network import Network
from swarmctl.bus.operator_service import AgentCommand
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.frames import IntentShared, MemberShared, StateShared
from swarmctl.core.messages import VehicleAnswer
from swarmctl.core.mission import FlightPlan
from swarmctl.core.observation import BeliefItem
from swarmctl.core.operator_text import extended
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.setpoint import SetPoint
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.arming_clearance import ArmingClearance
from swarmctl.links.base import (
    AddressChanged,
    FramesRefused,
    LinkError,
    LinkEvent,
    SystemIdConflict,
    UploadFailed,
)
from swarmctl.links.direct import DirectLink
from swarmctl.mavlink.events import FirstHeartbeat, ProcedureDone, StatusText
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.report.ui import Observer
from swarmctl.sensors import Sensor

_LINK_EVENTS = (ev.TelemetryReceived, ev.LinkLost, ev.LinkRestored, ev.Rebooted)
CRITICAL = 2  # MAV_SEVERITY
UPLOAD_RETRIES_S = (2.0, 4.0)
"""waits before the repetitions of a failed upload [s]"""
NEIGHBOURS_EVERY_S = 0.5
"""time between two readings of the neighbours' states, by the vehicle's clock [s]"""


class Runner:
    """The runner of one vehicle, from its mission on the ground to its landing. Run `run` as a task."""

    def __init__(
        self,
        task: Task,
        prior: Belief,
        open_link: Callable[[Callable[[LinkEvent], None]], DirectLink],
        sensor: Sensor,
        network: Network,
        observers: tuple[Observer, ...],
        *,
        offload: bool = False,
        recorded: AgentState | None = None,
    ) -> None:
        """`open_link` returns the vehicle's link, which calls the given function with its events.

        `recorded`: the state by an earlier program's record; folding then waits for `take_up`.
        """
        self.state = initial_state(task, prior) if recorded is None else recorded
        self._may_fold = asyncio.Event()
        self.is_untaken = recorded is not None
        """True until the vehicle is compared with its record: nothing may be sent to it before"""
        if recorded is None:
            self._may_fold.set()
        self.clearance = ArmingClearance(task.name)
        self.sysid_conflict = ""
        """a message about another sender with the vehicle's system id; empty if there is none"""
        self._sensor = sensor
        self._network = network
        self._observers = observers
        self._offload = offload
        self._inbox: deque[ev.Event] = deque()
        self._wake = asyncio.Event()
        self._is_running = False
        self._job: asyncio.Task[None] | None = None
        self._launch_conflict = ""
        """conflict of the first route during a launch, as the agent reports it; empty: none"""
        self._ending: set[asyncio.Task[None]] = set()
        """earlier jobs that were cancelled; the next job waits for their end"""
        self._neighbours_read_s = -math.inf
        self._received: list[BeliefItem] = []
        """observations received and not folded yet"""
        self._answer_to: dict[int, Callable[[VehicleAnswer], None]] = {}
        """receivers of answers, by the number of the command"""
        self.link = open_link(self.on_link_event)
        self.post(ev.Joined(network.join(task.uav, self._receive)))

    @property
    def name(self) -> str:
        return self.state.task.name

    def post(self, event: ev.Event) -> None:
        """Queue an event for `run`."""
        if not self._may_fold.is_set() and isinstance(event, _LINK_EVENTS):
            return  # `take_up` brings the latest state
        self._inbox.append(event)
        self._wake.set()

    def command(self, event: AgentCommand, answer_to: Callable[[VehicleAnswer], None]) -> None:
        """Queue an operator's command; the agent's answer goes to `answer_to`."""
        assert event.request_id is not None
        self._answer_to[event.request_id] = answer_to
        self.post(event)

    def take_up(self, events: Iterable[ev.Event]) -> None:
        """Begin to fold: first these events about the recorded flight, then the events in the queue."""
        joined, *later = self._inbox
        self._inbox = deque((joined, *events, *later))
        self._may_fold.set()
        self._wake.set()

    def _receive(self, items: tuple[BeliefItem, ...]) -> None:
        self._received += items
        self._wake.set()

    def on_link_event(self, event: LinkEvent) -> None:
        """Queue a link's report as events, or note the report; quick, because the receive path calls this."""
        match event:
            case ev.TelemetryReceived(state):
                if state.lat_deg is not None and state.lon_deg is not None:
                    self._network.moved(self.state.task.uav, state.lat_deg, state.lon_deg)
                self.post(self._with_messages(state))
                if cells := self._sensor.observe(state):
                    self.post(ev.Observed(cells))
            case ev.LinkLost() | ev.LinkRestored():
                self.post(event)
            case ev.Rebooted():
                self.clearance.withdraw()
                self.post(event)
                ground, air = "the program makes it ready again", "look for it if it was in the air"
                advice = ground if self.state.phase in ON_GROUND else air
                self.note(f"the vehicle has rebooted; {advice} [rebooted]", to_operator=True)
            case SystemIdConflict(address):
                self.sysid_conflict = (
                    f"a second sender, at {address}, uses system id {self.state.task.uav} too"
                )
                advice = "the frames of that sender are dropped; give each vehicle its own system id"
                self.note(f"{self.sysid_conflict}; {advice}", to_operator=True)
            case FramesRefused(text):
                self.note(text, to_operator=True)
            case AddressChanged(address):
                self.note(f"the vehicle now sends from {address}", to_operator=True)
            case StatusText(severity, text):
                # On the ground an autopilot repeats the reasons against arming; preflight reports them.
                in_flight = self.state.phase not in ON_GROUND and self.state.vehicle.armed
                self.note(f"autopilot: {text}", to_operator=in_flight and severity <= CRITICAL)
            case ProcedureDone(name, result):
                outcome = f"not completed: {event.failure}" if event.failure else "completed"
                text = f"procedure {name.replace('_', ' ')}: {outcome}"
                still_s = result.stood_still_s if isinstance(result, Swapped) else 0.0
                stood = f"; the vehicle held or stood still for {still_s:.1f} s" if still_s else ""
                self.note(extended(text, stood))
            case FirstHeartbeat():
                self.note("first heartbeat")

    def _with_messages(self, state: VehicleState) -> ev.TelemetryReceived:
        """Return telemetry with the new messages of other vehicles; states and intents come at intervals."""
        uav, take_new = self.state.task.uav, self._network.take_new
        if not self._may_fold.is_set():
            return ev.TelemetryReceived(state)
        members = () if self.state.task.formation is None else take_new(uav, MemberShared)
        if 0.0 <= state.time_boot_s - self._neighbours_read_s < NEIGHBOURS_EVERY_S:
            return ev.TelemetryReceived(state, members)
        self._neighbours_read_s = state.time_boot_s
        neighbours = relevant_states(self.state, take_new(uav, StateShared))
        return ev.TelemetryReceived(state, members, neighbours, take_new(uav, IntentShared))

    async def run(self) -> None:
        """Fold events until cancelled; a cancellation also ends the jobs."""
        await self._may_fold.wait()
        self._is_running = True
        try:
            await self._fold_all()
        finally:
            self._is_running = False

    @property
    def is_behind(self) -> bool:
        """Return whether `run` has not folded all events yet, for example during a long search."""
        return self._is_running and bool(self._inbox or self._received)

    async def _fold_all(self) -> None:
        async with asyncio.TaskGroup() as jobs:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._inbox or self._received:
                    if self._received:
                        # One event for all observations in the queue: a merge costs the same for any number.
                        items, self._received = tuple(self._received), []
                        await self._fold(ev.ObservationsReceived(items), jobs)
                    if self._inbox:
                        await self._fold(self._inbox.popleft(), jobs)
                if needs_tick(self.state, asyncio.get_running_loop().time()):
                    await self._fold(ev.Tick(), jobs)

    async def _fold(self, event: ev.Event, jobs: asyncio.TaskGroup) -> None:
        now = asyncio.get_running_loop().time()
        before = self.state
        if self._offload and isinstance(event, ev.Tick):
            # A search over a large area holds no GIL, so the loop can serve the other vehicles.
            self.state, effects = await asyncio.to_thread(step, before, event, now)
        else:
            self.state, effects = step(before, event, now)
        self.is_untaken = self.is_untaken and not isinstance(event, ev.Restarted)
        for observer in self._observers:
            observer.folded(before, event, self.state, effects, now)
        for effect in effects:
            self._perform(effect, jobs)

    def _perform(self, effect: ev.Effect, jobs: asyncio.TaskGroup) -> None:
        match effect:
            case ev.Publish(message, against, group):
                self._network.publish(self.state.task.uav, message, frozenset(against), group)
            case ev.SwapMission(mission):
                self._start(partial(self._swap, mission), jobs)
            case ev.LaunchConflict(text):
                self._launch_conflict = text
            case ev.Command(order, by_person):
                self._start(partial(self._order, order, check_mode_first=not by_person), jobs)
            case ev.SendSetPoint(set_point):
                self._send_set_point(set_point)
            case ev.SetSpeed(speed_m_s):
                self._start(partial(self._set_speed, speed_m_s), jobs)
            case ev.SetRange(reach):
                self._network.set_range(self.state.task.uav, None if reach == "all" else reach)
            case ev.Release():
                self._end_job()
            case ev.NotifyOperator(text):
                self.note(text, to_operator=True)
            case ev.Answer(request_id, answer):
                if (answer_to := self._answer_to.pop(request_id, None)) is not None:
                    answer_to(answer)

    def _send_set_point(self, set_point: SetPoint) -> None:
        if not self.link.send_setpoint(set_point):
            why = "the link sends no set-points to this vehicle [no-setpoints]"
            self.post(ev.OrderFailed(ev.FlightOrder.FORMATION, why))

    def _start(self, work: Callable[[], Awaitable[None]], jobs: asyncio.TaskGroup) -> None:
        """Cancel the running job now, and start the new job after the end of the running job.

        The cancellation happens here, so that a job replaced before its first step does nothing.
        """
        self._end_job()
        before = frozenset(self._ending)

        async def job() -> None:
            if before:
                await asyncio.wait(before)
            await work()

        self._job = jobs.create_task(job())

    def _end_job(self) -> None:
        """Cancel the running job once; the job may end later."""
        self._ending = {job for job in self._ending if not job.done()}
        if self._job is not None and not self._job.done():
            self._job.cancel()
            self._ending.add(self._job)
        self._job = None

    async def _swap(self, mission: PlannedMission) -> None:
        plan_id, on_ground = mission.plan_id, self.state.phase in ON_GROUND
        try:
            if on_ground:
                takes_s = await self._upload(mission.plan)
                self.post(ev.MissionAccepted(plan_id, takes_s))
                return
            self.post((await self.link.swap(mission.plan)).event(plan_id))
        except LinkError as error:
            self.post(ev.MissionFailed(plan_id, "unknown", str(error)))

    async def _upload(self, plan: FlightPlan) -> float:
        """Upload a plan on the ground, and again after a failure; return the expected time of a swap [s]."""
        for wait_s in UPLOAD_RETRIES_S:
            try:
                return await self.link.upload(plan)
            except UploadFailed:
                await asyncio.sleep(wait_s)
        return await self.link.upload(plan)

    async def _set_speed(self, speed_m_s: float) -> None:
        try:
            await self.link.set_speed(speed_m_s)
        except LinkError as error:
            self.post(ev.SpeedFailed(str(error)))

    async def _order(self, order: ev.FlightOrder, *, check_mode_first: bool) -> None:
        if order is ev.FlightOrder.LAUNCH:
            try:
                await self.clearance.confirm(self.link)
            except LinkError as error:  # the link has sent no launch command
                self.post(ev.OrderFailed(order, str(error), nothing_sent=True))
                return
        try:
            match order:
                case ev.FlightOrder.LAUNCH:
                    blocked = await self.link.launch(lambda: self._launch_conflict)
                    if blocked is not None:
                        self.post(ev.LaunchPostponed(blocked.failure or "", blocked.was_armed))
                        return
                case ev.FlightOrder.FORMATION:
                    await self.link.follow_setpoints()
                case _:
                    await self.link.order(order, check_mode_first=check_mode_first)
        except LinkError as error:
            self.post(ev.OrderFailed(order, str(error)))
        else:
            self.post(ev.OrderDone(order))

    def note(self, text: str, *, to_operator: bool = False) -> None:
        """Pass a line about this vehicle to all observers."""
        now = asyncio.get_running_loop().time()
        for observer in self._observers:
            observer.noted(self.state.task.uav, text, now, to_operator=to_operator)

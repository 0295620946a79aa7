"""`DirectLink`: the interface to one vehicle, by this program's own conversations over the front end.

Cancelling a call cancels its conversation on the wire. One call runs at a time; a second call raises `Busy`,
except:
- `order` interrupts the running call, as an operator needs it in an emergency.
- `upload` and `ask` wait for each other.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from swarmctl.core.events import FlightOrder, TelemetryReceived
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.setpoint import SetPoint
from swarmctl.core.vehicle import VehicleState
from swarmctl.links.base import (
    Busy,
    CommandFailed,
    LaunchFailed,
    LinkError,
    LinkEvent,
    NoAnswer,
    NotReady,
    PrepareFailed,
    UnsupportedVehicle,
    UploadFailed,
)
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.line import Channel
from swarmctl.links.signing import REMEDIES
from swarmctl.links.transports import TRANSPORTS
from swarmctl.links.url import Endpoint
from swarmctl.mavlink.events import FirstHeartbeat, Identity, ProcedureDone
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.basic import Done, Swapped, Uploaded
from swarmctl.mavlink.procedures.recognise import Recognised, recognise
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.outcome import LaunchBlocked
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.session import Session, SessionStep
from swarmctl.mavlink.telemetry.streams import Streaming

R = TypeVar("R")


class DirectLink:
    """Link that runs a `Session` in asyncio: one timer, one waiter, no polling.

    `on_event` is called from the loop, in the order of the events, and must not block.
    """

    def __init__(
        self,
        front_end: FrontEnd,
        endpoint: Endpoint,
        sysid: int,
        *,
        name: str,
        on_event: Callable[[LinkEvent], None],
        tlog: Path | None = None,
        streaming: Streaming | None = None,
    ) -> None:
        self.name = name
        self.sysid = sysid
        self.endpoint = endpoint
        self._front_end = front_end
        self._on_event = on_event
        self._tlog = tlog
        self._session = Session(MavlinkPeer(sysid), streaming)
        self._channel: Channel | None = None
        self._heartbeat_received = asyncio.Event()
        self._waiter: asyncio.Future[Any] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._on_waiting: Callable[[tuple[str, ...]], None] | None = None
        self._ground_lock = asyncio.Lock()
        """lock of uploads and requests on the ground, so that they run one after another"""
        # The owner of the front end may fail before it closes this link.
        front_end.at_close(self.close)

    def state(self) -> VehicleState:
        """Return the last known state."""
        return self._session.state

    def age_s(self) -> float:
        """Return the time since the last heartbeat, by the event loop's clock [s]; inf before the first."""
        return self._session.age_s(self._now())

    def items(self) -> tuple[MissionItem, ...]:
        """Return the mission items last verified on the vehicle, with item 0.

        Empty if none was verified, or if the mission on the vehicle has possibly changed since.
        """
        return self._session.items

    # Procedures

    async def connect(self, timeout_s: float) -> Identity:
        """Open the transport and `identify`. Raises also TransportError."""
        await self._attach()
        return await self.identify(timeout_s)

    async def identify(self, timeout_s: float) -> Identity:
        """Wait for a heartbeat and request the identity: another vehicle may have taken the address.

        This changes nothing on the vehicle. Raises NoAnswer, UnsupportedVehicle.
        """
        try:
            async with asyncio.timeout(timeout_s):
                await self._heartbeat_received.wait()
                if self._session.unsupported:
                    raise UnsupportedVehicle(f"{self._label}: {self._session.unsupported}")
                version: Message | Done = await self._perform("identify", basic.identify)
        except TimeoutError:
            raise self._no_answer(timeout_s) from None
        if isinstance(version, Done):
            raise LinkError(f"{self._label}: AUTOPILOT_VERSION was not received: {version.failure}")
        return self._session.identity(version)

    async def prepare(self, timeout_s: float, on_waiting: Callable[[tuple[str, ...]], None]) -> None:
        """Request streams, set hold mode and wait until the vehicle is ready to arm.

        `on_waiting` gets the reasons for waiting, now and with each new state. Raises NotReady with the last
        reasons, PrepareFailed.
        """
        self._require_connection()
        on_waiting(self._session.state.not_ready)
        self._on_waiting = on_waiting
        self._apply(self._session.keep_streams(self._now()))
        try:
            async with asyncio.timeout(timeout_s):
                done: Done = await self._perform("prepare for arming", basic.prepare)
        except TimeoutError:
            raise self._not_ready(timeout_s) from None
        finally:
            self._on_waiting = None
        self._check(done, PrepareFailed, "the vehicle is not prepared")

    async def upload(self, plan: FlightPlan) -> float:
        """Upload a plan on the ground, read it back and compare; return the expected time of a swap [s].

        Raises UploadFailed.
        """
        self._require_connection()
        try:
            items = self._session.mission_items(plan)
        except ValueError as error:
            raise UploadFailed(f"{self._label}: the plan cannot be flown: {error}") from error
        async with self._ground_lock:
            done: Uploaded = await self._perform("upload", partial(basic.upload, items=items))
        self._check(done, UploadFailed, "the mission is not verified on the vehicle")
        return done.swap_takes_s

    async def ask(self, subject: str, procedure: Callable[[Context], Procedure[R]]) -> R:
        """Run a procedure on the ground, after uploads and other such procedures; return its result.

        Raises LinkError after an interruption, and for a failure of a procedure that returns `Done`.
        """
        async with self._ground_lock:
            result: R = await self._perform(subject, procedure)
        if isinstance(result, Done):
            self._check(result, LinkError, subject)
        return result

    async def launch(self, blocked_by: Callable[[], str] = lambda: "") -> LaunchBlocked | None:
        """Arm and start the mission; return when the vehicle climbs. THIS ARMS THE VEHICLE.

        `blocked_by` returns the current obstacle to the take-off as text, or "". The link calls `blocked_by`
        right before arming and right before the take-off. No command follows once another party has chosen a
        mode or armed the vehicle. The result is None after the take-off. Raises LaunchFailed.
        """
        if why_not := await self._front_end.why_not_arm():
            raise LaunchFailed(f"{self._label}: the vehicle is not armed: {why_not}")
        done: Done = await self._perform("launch", partial(basic.launch, blocked_by=blocked_by))
        if isinstance(done, LaunchBlocked):
            return done
        if done.failure:
            raise LaunchFailed(f"{self._label}: {done.failure}")
        return None

    async def swap(self, plan: FlightPlan) -> Swapped:
        """Upload and verify `plan` in flight and fly it, without hold mode if possible.

        If the plan first follows the old plan (`leaves_ahead`), the vehicle continues at its next item. No
        command follows once another party has chosen a mode.
        """
        done: Swapped = await self._perform("swap", partial(basic.swap, plan=plan))
        return done

    async def recognise(self, plans: Mapping[int, FlightPlan], candidates: Sequence[int]) -> Recognised:
        """Find out which of this program's plans a vehicle in flight stores and flies; change nothing.

        A recognised mission counts as verified. `plans`, `candidates`: see `procedures.recognise`. Raises
        LinkError if the vehicle cannot be read.
        """
        self._require_connection()
        self._apply(self._session.keep_streams(self._now()))
        procedure = partial(recognise, plans=plans, candidates=candidates)
        done: Recognised = await self._perform("recognise", procedure)
        self._check(done, LinkError, "the stored mission cannot be read")
        return done

    async def order(self, order: FlightOrder, *, check_mode_first: bool = False) -> None:
        """Order the vehicle to hold, return or land, in place of the running call. Raises CommandFailed.

        The first command is sent at once in any mode; repetitions stop once another party has chosen a mode.
        If `check_mode_first`, a mode that has just changed stops the first command too; use this for commands
        that no operator has given. Before a command that disarms or may arm, the mode is always checked.

        A vehicle that follows set-points in its hold mode stops. A copter lands at its position, a fixed wing
        at a landing of its mission; on the ground it is disarmed.
        """
        if self._waiter is not None:
            self._interrupt(order)
        procedure = partial(basic.ORDERS[order], check_mode_first=check_mode_first)
        done: Done = await self._perform(order, procedure)
        self._check(done, CommandFailed, f"{order} failed")

    async def follow_setpoints(self) -> None:
        """Make a vehicle that flies its mission follow set-points. Raises CommandFailed.

        No command follows once another party has chosen a mode. The caller sends set-points from before this
        call on: PX4 refuses the mode without them.
        """
        done: Done = await self._perform("follow set-points", basic.follow_setpoints)
        self._check(done, CommandFailed, "the vehicle does not follow set-points")

    def send_setpoint(self, setpoint: SetPoint) -> bool:
        """Send a set-point now, also during another call, without an answer; return whether it was sent.

        False: the vehicle is not connected, or does not follow set-points, such as a fixed wing. A vehicle in
        another mode ignores set-points, but PX4 returns to OFFBOARD if it left OFFBOARD for want of them.
        Raises ValueError for a set-point that is incomplete or not finite.
        """
        message = self._session.setpoint_message(setpoint, self._now())
        if message is None or self._channel is None:
            return False
        self._channel.send([message])
        return True

    async def set_speed(self, speed_m_s: float) -> None:
        """Set the speed until the mode changes. Raises CommandFailed, also outside of mission mode."""
        done: Done = await self._perform("set_speed", partial(basic.set_speed, speed_m_s=speed_m_s))
        self._check(done, CommandFailed, "set_speed failed")

    def close(self) -> None:
        """Close the link. Idempotent; the front end also calls this when it closes."""
        if self._waiter is not None:
            self._interrupt("closing the link")
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._channel is not None:
            self._channel.detach()
            self._channel = None

    # Running procedures

    async def _attach(self) -> None:
        if self._channel is not None:
            return
        await self._front_end.open(self.endpoint)
        try:
            self._channel = self._front_end.attach(
                self.endpoint,
                self.sysid,
                on_message=self._on_message,
                on_event=self._on_event,
                tlog=self._tlog,
                read_ids=self._session.read_ids,
                may_move=lambda: self._session.may_change_address,
            )
        except LinkError as error:
            raise LinkError(f"{self.name}: {error}") from None

    async def _perform(self, name: str, procedure: Callable[[Context], Procedure[Any]]) -> Any:
        self._require_connection()
        if self._session.busy_with is not None:
            raise Busy(
                f"{self._label}: {name} is refused while {self._session.busy_with} runs; wait for its end, "
                "or command hold"
            )
        waiter = self._waiter = asyncio.get_running_loop().create_future()
        self._apply(self._session.begin(name, procedure, self._now()))
        try:
            return await waiter
        except asyncio.CancelledError:
            if self._waiter is waiter:
                self._waiter = None
                self._apply(self._session.cancel(self._now()))
            raise

    def _interrupt(self, by: str) -> None:
        waiter, self._waiter = self._waiter, None
        self._apply(self._session.cancel(self._now()))
        if waiter is not None and not waiter.done():
            # A Swapped is a Done, so it fits every waiter.
            waiter.set_result(Swapped(f"interrupted by {by} [interrupted]"))

    def _on_message(self, message: Message) -> None:
        self._apply(self._session.receive(message, self._now()))

    def _on_timer(self) -> None:
        assert self._timer is not None
        now = max(self._now(), self._timer.when())  # a loop may call a little early
        self._timer = None
        self._apply(self._session.tick(now))

    def _apply(self, step: SessionStep) -> None:
        if self._channel is not None:
            self._channel.send(step.messages)
        self._set_timer()
        for event in step.events:
            if isinstance(event, FirstHeartbeat):
                self._heartbeat_received.set()
            elif isinstance(event, ProcedureDone) and self._waiter is not None:
                waiter, self._waiter = self._waiter, None
                if not waiter.done():
                    waiter.set_result(event.result)
            elif self._on_waiting and isinstance(event, TelemetryReceived) and event.state.not_ready:
                self._on_waiting(event.state.not_ready)
            self._on_event(event)

    def _set_timer(self) -> None:
        deadline = self._session.next_deadline
        if deadline is None or self._channel is None:
            return
        if self._timer is not None:
            # An early timer costs one idle tick; a new timer for every message would cost more.
            if self._timer.when() <= deadline:
                return
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_at(deadline, self._on_timer)

    def _now(self) -> float:
        return asyncio.get_running_loop().time()

    # Error texts

    @property
    def _label(self) -> str:
        return f"{self.name} (system {self.sysid} at {self.endpoint})"

    def _check(self, done: Done, error: Callable[[str], LinkError], problem: str) -> None:
        """Raise `error` if the procedure has failed."""
        if done.failure:
            raise error(f"{self._label}: {problem}: {done.failure}")

    def _require_connection(self) -> None:
        if not self._heartbeat_received.is_set() or self._session.unsupported:
            raise LinkError(f"{self._label}: not connected [not-connected]")

    def _no_answer(self, tried_s: float) -> NoAnswer:
        if self._heartbeat_received.is_set():
            problem, code = "a heartbeat has arrived, but no AUTOPILOT_VERSION", ""
            check = "do requests reach the vehicle (one-way link, wrong port, signing)?"
        else:
            problem, code = "no heartbeat", " [no-heartbeat]"
            check = TRANSPORTS[self.endpoint.kind].check
            if refusal := self._front_end.last_refusal_on(self.endpoint, self.sysid):
                problem, code = f"the vehicle's frames are refused: {refusal}", " [frames-refused]"
                check = REMEDIES.get(refusal, "do the clocks of the vehicle and of this machine agree?")
            other_ids = sorted(self._front_end.systems_on(self.endpoint) - {self.sysid})
            if other_ids and not refusal:
                ids = ", ".join(map(str, other_ids))
                check = f"this endpoint receives only system ids {ids}; is the configured system id right?"
        trouble = self._front_end.trouble_on(self.endpoint)
        cause = f" ({trouble})" if trouble else ""
        text = f"{self._label}: {problem}{cause}; tried for {tried_s:g} s; {check}{code}"
        return NoAnswer(text, url=str(self.endpoint), sysid=self.sysid, tried_s=tried_s)

    def _not_ready(self, tried_s: float) -> NotReady:
        reasons = self._session.state.not_ready or ("the vehicle gives no reason",)
        silent_s = self.age_s()
        silence = f"; no heartbeat for {silent_s:.0f} s" if silent_s > 3.0 else ""
        text = f"{self._label}: not ready to arm after {tried_s:g} s: {'; '.join(reasons)}{silence}"
        return NotReady(text, reasons=reasons)

"""Frames to and from the vehicle under test. A `Wire` transfers the bytes and provides the time."""

import math
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.dialects import VehicleIdentity
from sim_vehicle.conformance.frames import LONGEST_FRAME, messages_in
from sim_vehicle.conformance.guard import Forbidden, is_read_only, refusal, target_of
from sim_vehicle.conformance.outcomes import CheckFailed, Skip
from sim_vehicle.station.exchanges import Exchange, ExchangeOutcome
from sim_vehicle.station.frames import NOISE, STATION, ReceivedFrame, Receiver, Sender, Source
from sim_vehicle.station.messages import heartbeat

Condition = Callable[[Any], bool]
HEARTBEAT_S = 1.0  # period of the station's heartbeats
REPLY_S = 1.5  # default wait for an answer; an idle autopilot answers much earlier
ATTEMPTS = 3  # transmissions of a request
RESTORE_S = 60.0  # time for undoing a change, even after the time limit of a check
MAX_SYSID = 250  # highest result of `unused_sysid`; stations often use the system ids above
EPSILON_S = 1e-6  # tolerance for sums of times
PACES = 0.1, 10.0  # a measured pace outside of these limits is a wrong clock, not a slow machine
SAME_PACE = 0.05  # a smaller change of the pace is ignored
SECOND_STATION = (254, 191)


class WireError(OSError):
    """An unusable link; the text has the remedy."""


class Wire(Protocol):
    """A link to one or more vehicles."""

    def send(self, data: bytes) -> None:
        """Send to the peer; a listening UDP port has several peers before `follow`."""

    def receive(self, timeout_s: float) -> bytes | None:
        """Return the next bytes within `timeout_s` [s of vehicle time], or None."""

    def now_s(self) -> float:
        """Return the vehicle time [s], which never decreases."""

    def follow(self, sysid: int) -> None:
        """Choose the vehicle that receives every later `send`, if the link has several peers."""

    def close(self) -> None: ...


def is_autopilot(heartbeat: Any) -> bool:
    """Return True for the HEARTBEAT of an autopilot; a camera on board has the same system id."""
    return bool(heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID)


class Traffic:
    """The messages between the suite's ground stations and one vehicle.

    During each wait the station receives frames and sends one heartbeat per second.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self.permissions: frozenset[str] = frozenset()  # allowed actions on the vehicle (`guard.PERMISSIONS`)
        self.identity = VehicleIdentity(0, 1, mavlink.MAV_AUTOPILOT_INVALID, 0)
        self.received: list[ReceivedFrame] = []  # from the vehicle since the check began
        self.last: dict[str, Any] = {}  # the latest message of each kind
        self.heartbeat_s = 0.0  # time of the autopilot's latest heartbeat
        self.texts: list[Any] = []  # every STATUSTEXT of the run
        self.noise = bytearray()  # outside of valid frames since the check began
        self.heartbeats_off = False
        self.deadline_s = math.inf
        self.seen_sysids: set[int] = set()  # of all senders so far, including other vehicles
        self.saved_plans: set[int] = set()  # MAV_MISSION_TYPE of each plan that the suite may overwrite
        self.sender, self._receiver = Sender(), Receiver()
        self._next_heartbeat_s = 0.0
        self._sent_tail = b""  # the last bytes sent, because a frame may be sent in pieces
        # Seconds of the vehicle's clock in a second of the wire, since (time of the wire, `now`).
        self._pace, self._pace_since = 1.0, (0.0, 0.0)

    @property
    def wire_s(self) -> float:
        """Return the time of the wire [s]: wall time, multiplied by the expected speed of the vehicle."""
        return self._wire.now_s()

    @property
    def now(self) -> float:
        """Return the vehicle time [s], at the measured pace of the vehicle's clock."""
        wire_s, now_s = self._pace_since
        return now_s + (self.wire_s - wire_s) * self._pace

    def set_pace(self, pace: float) -> None:
        """Go on at the measured pace of the vehicle's clock: a simulation may run slower than expected."""
        if PACES[0] <= pace <= PACES[1] and abs(pace - self._pace) > SAME_PACE * self._pace:
            self._pace_since = self.wire_s, self.now
            self._pace = pace

    def _next_bytes(self, timeout_s: float) -> bytes | None:
        return self._wire.receive(timeout_s / self._pace)

    @property
    def target(self) -> tuple[int, int]:
        return self.identity.sysid, self.identity.component

    def send(self, message: Any, source: Source = STATION) -> None:
        """Send a message as a station of the suite; only a wait processes the answers."""
        self.send_raw(self.sender.pack(message, source))

    def send_raw(self, data: bytes) -> None:
        """Send the bytes, or raise the error of `objection`. Every method sends through this method."""
        objection = self.objection(data)
        if objection is not None:
            raise objection
        self._sent_tail = (self._sent_tail + data)[-LONGEST_FRAME:]
        self._wire.send(data)

    def objection(self, data: bytes) -> Skip | Forbidden | None:
        """Return the error that forbids sending these bytes, or None.

        A frame that could change another vehicle is `Forbidden`; no option allows such a frame.
        """
        own = self.identity.sysid  # 0 before the connection
        for message in messages_in(self._sent_tail + data, len(self._sent_tail)):
            target = target_of(message)
            if (own == 0 or target != own) and not is_read_only(message):
                return Forbidden(f"{message.get_type()} is for system {target}, not for {own}")
            reason = refusal(message, self.permissions, self.saved_plans)
            if reason is not None:
                return Skip(reason)
        return None

    def unused_sysid(self) -> int:
        """Return a system id that no sender has used so far; raise Skip if all are in use."""
        for step in range(1, MAX_SYSID):
            sysid = (self.identity.sysid + step - 1) % MAX_SYSID + 1
            if sysid not in self.seen_sysids:
                return sysid
        raise Skip(f"every system id from 1 to {MAX_SYSID} is in use")

    def begin_check(self, limit_s: float = math.inf) -> None:
        """Clear the received frames and set the time limit of the check that begins [s]."""
        self.deadline_s = math.inf
        self._pump(0.0)
        self.received.clear()
        self.noise.clear()
        self.heartbeats_off = False
        self.deadline_s = self.now + limit_s

    @contextmanager
    def extra_time(self) -> Iterator[None]:
        """Extend the deadline, so that a restoring message can be repeated on a lossy link."""
        before_s = self.deadline_s
        self.deadline_s = max(before_s, self.now + RESTORE_S)
        try:
            yield
        finally:
            self.deadline_s = before_s

    def _pump(self, timeout_s: float) -> None:
        """Wait at most `timeout_s` [s] for bytes, and process them; raise CheckFailed after the deadline."""
        if self.now > self.deadline_s:
            raise CheckFailed("the time limit of the check has passed [time-limit]")
        if self.now >= self._next_heartbeat_s - EPSILON_S:
            self._next_heartbeat_s = self.now + HEARTBEAT_S
            if not self.heartbeats_off:
                self.send(heartbeat())
        data = self._next_bytes(min(timeout_s, max(0.0, self._next_heartbeat_s - self.now)))
        while data is not None:
            self._receive(data)
            data = self._next_bytes(0.0)

    def _receive(self, data: bytes) -> None:
        for frame in self._receiver.frames(data, self.now):
            if frame.kind == NOISE:
                self.noise += frame.raw
                continue
            self.seen_sysids.add(frame.sysid)
            if self.identity.sysid not in (0, frame.sysid):
                continue
            self.received.append(frame)
            self._keep_latest(frame)
            if frame.kind == "STATUSTEXT":
                self.texts.append(frame.message)

    def _keep_latest(self, entry: ReceivedFrame) -> None:
        if entry.kind == "HEARTBEAT":
            if not is_autopilot(entry.message):
                return
            self.heartbeat_s = entry.at_s
        self.last[entry.kind] = entry.message

    def mark(self) -> int:
        """Return a mark: the index that the next frame will have in `received`."""
        return len(self.received)

    def since(self, mark: int, kind: str) -> list[Any]:
        """Return the messages of one kind after a mark."""
        return [entry.message for entry in self.received[mark:] if entry.kind == kind]

    def wait(self, seconds: float) -> list[ReceivedFrame]:
        """Receive frames for `seconds`; return them."""
        mark, end_s = self.mark(), self.now + seconds
        while self.now < end_s - EPSILON_S:
            self._pump(end_s - self.now)
        return self.received[mark:]

    def listen(self, kind: str, seconds: float) -> list[Any]:
        """Return the messages of one kind that arrive in `seconds`."""
        return [entry.message for entry in self.wait(seconds) if entry.kind == kind]

    def wait_until(self, condition: Callable[[], bool], description: str, within_s: float) -> float:
        """Wait for a condition; return the time taken [s]. CheckFailed quotes `description`."""
        began_s = self.now
        while not condition():
            if self.now - began_s > within_s:
                raise CheckFailed(f"expected {description} within {within_s:g} s")
            self._pump(0.1)
        return self.now - began_s

    def seek(
        self, kinds: Collection[str], where: Condition | None = None, *, within_s: float, mark: int | None
    ) -> int | None:
        """Wait for a message of these kinds after a mark, or after now; return its index in `received`."""
        end_s = self.now + within_s
        mark = self.mark() if mark is None else mark
        while True:
            for index in range(mark, len(self.received)):
                entry = self.received[index]
                if entry.kind in kinds and (where is None or where(entry.message)):
                    return index
            if self.now >= end_s - EPSILON_S:
                return None
            mark = self.mark()
            self._pump(end_s - self.now)

    def wait_for(
        self, kind: str, where: Condition | None = None, *, within_s: float = REPLY_S, mark: int | None = None
    ) -> Any | None:
        """Wait for a message after `mark`, by default after now; return the message or None."""
        index = self.seek((kind,), where, within_s=within_s, mark=mark)
        return None if index is None else self.received[index].message

    def expect(
        self,
        kind: str,
        where: Condition | None = None,
        *,
        within_s: float = REPLY_S,
        mark: int | None = None,
        description: str = "",
    ) -> Any:
        """Return the message of `wait_for`; raise CheckFailed if none arrives."""
        message = self.wait_for(kind, where, within_s=within_s, mark=mark)
        if message is None:
            raise CheckFailed(f"expected {description or kind} within {within_s:g} s, saw none")
        return message

    def expect_text(self, words: str, mark: int) -> str:
        """Return the first STATUSTEXT with these words after a mark; raise CheckFailed if there is none."""
        found = self.expect("STATUSTEXT", lambda m: words in m.text, mark=mark, description=f"'{words}'")
        return str(found.text)

    def expect_none(self, kind: str, where: Condition | None = None, *, during_s: float) -> None:
        """Wait `during_s` [s]; raise CheckFailed if a matching message arrives."""
        message = self.wait_for(kind, where, within_s=during_s)
        if message is not None:
            raise CheckFailed(f"expected no {kind}, saw {message}")

    def ask(
        self, message: Any, kind: str, where: Condition | None = None, *, source: Source = STATION
    ) -> Any:
        """Send a message up to `ATTEMPTS` times and return the answer; raise CheckFailed if none arrives."""

        def fits(answer: Any) -> bool:
            return answer.get_type() == kind and (where is None or where(answer))

        exchange = Exchange(
            lambda m: self.send(m, source), message, is_answer=fits, resend_s=REPLY_S, attempts=ATTEMPTS
        )
        outcome = self.complete(exchange)
        if outcome.message is None:
            raise CheckFailed(f"expected {kind} for {message.get_type()}, saw {outcome.text}")
        return outcome.message

    def complete(self, exchange: Exchange) -> ExchangeOutcome:
        """Run an exchange with the vehicle to its end."""
        mark = self.mark()
        exchange.begin(self.now)
        while True:
            for frame in self.received[mark:]:
                if exchange.outcome is None:
                    exchange.receive(frame.message, frame.at_s)
            if exchange.outcome is not None:
                return exchange.outcome
            mark = self.mark()
            self._pump(max(0.0, exchange.due_s - self.now))
            exchange.tick(self.now)

"""A ground station without I/O: it runs the script of a scenario and keeps the state of each vehicle."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import HEADER_BYTES, MAVLINK2
from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.scenarios.model import Scenario, VehicleSpec
from sim_vehicle.scenarios.step_exchanges import StepExchanges
from sim_vehicle.scenarios.steps import ScriptStep
from sim_vehicle.station.exchanges import Exchange
from sim_vehicle.station.frames import NOISE, Receiver, Sender
from sim_vehicle.station.messages import StatusTexts, heartbeat

HEARTBEAT_S = 1.0
SETTLED_S = 3.0  # delay after the first heartbeat; some autopilots undo an earlier mode change
RETRY_S = 1.0  # delay after a refusal
STREAMS_MISSING_S = 5.0  # time without telemetry after which streams are requested
STREAM_HZ = 4
EMPTY_FRAME_BYTES = HEADER_BYTES[MAVLINK2] + 2  # a frame without payload and signature
PROCESSED_IDS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_ACK,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
    }
)

FrameSink = Callable[[int, bytes, float], None]  # (index of the vehicle, frame, time [s])
LinkFrames = list[tuple[int, bytes]]  # (link, frame)


@dataclass(frozen=True, slots=True)
class StepFailure:
    """A failed step; `index` counts the script's steps from 0 (-1: a step of `append_step`)."""

    index: int
    action: str
    sysid: int
    t_s: float
    text: str


@dataclass
class _StepRun:
    """One step with one vehicle."""

    index: int
    step: ScriptStep
    exchanges: list[Exchange]
    began_s: float | None = None
    retry_s: float | None = None
    answer: str = "no answer [no-answer]"  # or the text of the last refusal


@dataclass
class Contact:
    """The state of one vehicle; times in simulated seconds."""

    spec: VehicleSpec
    pending: deque[_StepRun] = field(default_factory=deque)
    first_heartbeat_s: float | None = None
    last_heartbeat_s: float = 0.0
    telemetry_s: float = 0.0  # time of the last position
    streams_requested_s: float = -STREAMS_MISSING_S
    status_texts: StatusTexts = field(default_factory=StatusTexts)
    messages: int = 0

    @property
    def texts(self) -> Sequence[str]:
        return self.status_texts.texts


class ScriptStation:
    """A ground station that runs the steps of a script, in parallel for all vehicles.

    scenario: scenario with the vehicles and the script.
    on_frame: receiver of every whole message, in both directions.
    """

    def __init__(self, scenario: Scenario, *, on_frame: FrameSink) -> None:
        self._on_frame = on_frame
        self.contacts = [Contact(spec) for spec in scenario.vehicles]
        self.failures: list[StepFailure] = []
        self._links = sorted({spec.link for spec in scenario.vehicles})
        self._senders = {link: Sender() for link in self._links}
        self._receivers = [Receiver() for _ in scenario.vehicles]
        self._has_intact_frames = not scenario.faults  # most intact frames need no slow decoding
        self._outbox: LinkFrames = []
        self._now = 0.0
        self._next_heartbeat_s = 0.0
        self._heartbeat_switches = sorted(
            (step.at_s, step.heartbeat) for step in scenario.script if step.heartbeat is not None
        )
        for index, contact in enumerate(self.contacts):
            for number, step in enumerate(scenario.script):
                selected = step.vehicles is None or contact.spec.sysid in step.vehicles
                if selected and step.heartbeat is None:
                    self.append_step(index, step, number)

    @property
    def done(self) -> bool:
        """True if every step has ended."""
        return not any(contact.pending for contact in self.contacts)

    def append_step(self, index: int, step: ScriptStep, number: int = -1) -> None:
        """Append a step after the pending steps of one vehicle; `number`: its index in the script."""
        contact = self.contacts[index]
        exchanges = StepExchanges(contact.spec, self._sender(index)).exchanges(step)
        contact.pending.append(_StepRun(number, step, exchanges))

    def receive(self, index: int, data: bytes, now: float) -> None:
        """Process bytes of one vehicle."""
        self._now = now
        if self._has_intact_frames and _is_plain_telemetry(data):
            self.contacts[index].messages += 1
            self._on_frame(index, data, now)
            return
        for frame in self._receivers[index].frames(data, now):
            if frame.kind.startswith((NOISE, "UNKNOWN_")):
                continue  # noise or a damaged header; the codec cannot verify an unknown message
            self._on_frame(index, frame.raw, now)
            self._note(index, frame.message, now)

    def step(self, now: float) -> LinkFrames:
        """Return the messages to send by `now`, as (link, bytes)."""
        self._now = now
        if now + EPSILON_S >= self._next_heartbeat_s:
            self._next_heartbeat_s += HEARTBEAT_S
            if self._heartbeats_enabled(now):
                self._send_heartbeat()
        for index, contact in enumerate(self.contacts):
            if contact.first_heartbeat_s is not None:
                self._request_streams(index, contact, now)
                self._advance(contact, now)
        out, self._outbox = self._outbox, []
        return out

    def unfinished(self) -> list[StepFailure]:
        """Return the unfinished steps as failures."""
        return [
            StepFailure(
                running.index,
                running.step.chosen,
                contact.spec.sysid,
                self._now,
                "the run ended before the end of this step [unfinished]",
            )
            for contact in self.contacts
            for running in contact.pending
        ]

    # -- in ----------------------------------------------------------------------------------------------

    def _note(self, index: int, message: Any, now: float) -> None:
        contact = self.contacts[index]
        contact.messages += 1
        kind = message.get_type()
        if message.get_srcSystem() != contact.spec.sysid:
            return  # a message of another system, such as the telemetry radio
        if kind == "HEARTBEAT":
            contact.last_heartbeat_s = now
            if contact.first_heartbeat_s is None:
                contact.first_heartbeat_s = now
        elif kind == "STATUSTEXT":
            contact.status_texts.receive(message)
        elif kind == "GLOBAL_POSITION_INT":
            contact.telemetry_s = now
        if contact.pending and contact.pending[0].began_s is not None:
            running = contact.pending[0]
            if running.exchanges and running.retry_s is None and running.exchanges[0].outcome is None:
                running.exchanges[0].receive(message, now)
                self._advance(contact, now)

    # -- out ---------------------------------------------------------------------------------------------

    def _sender(self, index: int) -> Callable[[Any], None]:
        link = self.contacts[index].spec.link

        def send(message: Any) -> None:
            frame = self._senders[link].pack(message)
            self._outbox.append((link, frame))
            self._on_frame(index, frame, self._now)

        return send

    def _heartbeats_enabled(self, now: float) -> bool:
        past = [on for at_s, on in self._heartbeat_switches if at_s <= now + EPSILON_S]
        return past[-1] if past else True

    def _send_heartbeat(self) -> None:
        for link in self._links:
            frame = self._senders[link].pack(heartbeat())
            self._outbox.append((link, frame))
            for index, contact in enumerate(self.contacts):
                if contact.spec.link == link:
                    self._on_frame(index, frame, self._now)

    def _request_streams(self, index: int, contact: Contact, now: float) -> None:
        quiet_s = now - max(contact.telemetry_s, contact.streams_requested_s)
        if quiet_s < STREAMS_MISSING_S or not self._heartbeats_enabled(now):
            return
        contact.streams_requested_s = now
        self._sender(index)(
            mavlink.MAVLink_request_data_stream_message(
                contact.spec.sysid, 1, mavlink.MAV_DATA_STREAM_ALL, STREAM_HZ, 1
            )
        )

    def _advance(self, contact: Contact, now: float) -> None:
        while contact.pending and self._advance_step(contact, contact.pending[0], now):
            contact.pending.popleft()

    def _advance_step(self, contact: Contact, running: _StepRun, now: float) -> bool:
        """Advance a step; return True if it has ended."""
        assert contact.first_heartbeat_s is not None
        if running.began_s is None:
            if now + EPSILON_S < max(running.step.at_s, contact.first_heartbeat_s + SETTLED_S):
                return False
            running.began_s = now
            running.exchanges[0].begin(now)
        exchange = running.exchanges[0]
        if running.retry_s is not None:
            if now < running.retry_s:
                return False
            running.retry_s = None
            exchange.begin(now)
        exchange.tick(now)
        if exchange.outcome is None:
            return now - running.began_s >= running.step.timeout_s and self._failed(
                contact, running, now, running.answer
            )
        if exchange.outcome.accepted:
            return self._accepted(contact, running, now)
        return self._refused(contact, running, now, exchange.outcome.text)

    def _accepted(self, contact: Contact, running: _StepRun, now: float) -> bool:
        running.exchanges.pop(0)
        if running.exchanges:
            running.exchanges[0].begin(now)
            return False
        if running.step.expect == "refused":
            return self._failed(
                contact, running, now, "the command was accepted; a refusal was expected [not-refused]"
            )
        return True

    def _refused(self, contact: Contact, running: _StepRun, now: float, text: str) -> bool:
        assert running.began_s is not None
        if running.step.expect != "accepted":
            return True
        running.answer = text + (f"; last text: {contact.texts[-1]!r}" if contact.texts else "")
        if now - running.began_s >= running.step.timeout_s:
            return self._failed(contact, running, now, running.answer)
        running.retry_s = now + RETRY_S
        return False

    def _failed(self, contact: Contact, running: _StepRun, now: float, text: str) -> bool:
        self.failures.append(StepFailure(running.index, running.step.chosen, contact.spec.sysid, now, text))
        return True


def _is_plain_telemetry(data: bytes) -> bool:
    """Return True for one whole unsigned frame of a kind that the station does not process."""
    is_mavlink2 = len(data) >= EMPTY_FRAME_BYTES and data[0] == MAVLINK2
    is_whole = is_mavlink2 and len(data) == data[1] + EMPTY_FRAME_BYTES
    return is_whole and int.from_bytes(data[7:10], "little") not in PROCESSED_IDS

"""A small ground station without I/O: it follows a script, and keeps what it hears of each vehicle."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.scenarios.model import Scenario, VehicleSpec
from sim_vehicle.scenarios.progress import MissionProgress
from sim_vehicle.scenarios.recipes import Recipes
from sim_vehicle.scenarios.steps import Step
from sim_vehicle.scenarios.texts import Texts
from sim_vehicle.station.exchanges import Exchange
from sim_vehicle.wire.frame import HEADER2_BYTES, MAVLINK2

HEARTBEAT_S = 1.0
SETTLED_S = 3.0  # after the first heartbeat: a mode set earlier is undone by some autopilots
RETRY_S = 1.0  # after a refusal that time may cure
STREAMS_ASKED_S = 5.0  # without telemetry for so long, streams are asked for (again)
STREAM_HZ = 4
FRAME_BYTES = HEADER2_BYTES + 2  # a frame without payload and signature
AWAITED = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_ACK,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
    }
)
SYSTEM, COMPONENT = 255, mavlink.MAV_COMP_ID_MISSIONPLANNER

Heard = Callable[[int, bytes, float], None]
Out = list[tuple[int, bytes]]


@dataclass(frozen=True, slots=True)
class StepFailure:
    """A step that did not end as it should have; `index` counts the script's steps from 0."""

    index: int
    action: str
    sysid: int
    t_s: float
    text: str


@dataclass
class _Job:
    """One step with one vehicle."""

    index: int
    step: Step
    exchanges: list[Exchange]
    began_s: float | None = None
    retry_s: float | None = None
    answer: str = "no answer"  # the last refusal


@dataclass
class Contact:
    """What is known of one vehicle; times in s."""

    spec: VehicleSpec
    jobs: deque[_Job] = field(default_factory=deque)
    first_heard_s: float | None = None
    heard_s: float = 0.0  # the last heartbeat
    telemetry_s: float = 0.0
    streams_asked_s: float = -STREAMS_ASKED_S
    heard: Texts = field(default_factory=Texts)
    messages: int = 0

    def __post_init__(self) -> None:
        self.progress = MissionProgress(self.spec)

    @property
    def texts(self) -> Sequence[str]:
        return self.heard.said


class Station:
    """`script` steps run one after another with each vehicle, and side by side with all of them.

    Parameters
    ----------
    scenario: its vehicles and script.
    heard: called with vehicle index, frame and time for every whole message, in both directions.
    """

    def __init__(self, scenario: Scenario, *, heard: Heard = lambda _index, _frame, _now: None) -> None:
        self._heard = heard
        self.contacts = [Contact(spec) for spec in scenario.vehicles]
        self.failures: list[StepFailure] = []
        self._links = sorted({spec.link for spec in scenario.vehicles})
        self._codecs = {link: mavlink.MAVLink(None, SYSTEM, COMPONENT) for link in self._links}
        self._parsers = [_parser() for _ in scenario.vehicles]
        self._frames_are_sound = not scenario.faults  # then most need not be decoded, which takes time
        self._outbox: Out = []
        self._now = 0.0
        self._next_heartbeat_s = 0.0
        self._heartbeats = sorted(
            (step.at_s, step.heartbeat) for step in scenario.script if step.heartbeat is not None
        )
        for index, contact in enumerate(self.contacts):
            recipes = Recipes(contact.spec, self._sender(index))
            for number, step in enumerate(scenario.script):
                meant = step.vehicles is None or contact.spec.sysid in step.vehicles
                if meant and step.heartbeat is None:
                    contact.jobs.append(_Job(number, step, recipes.exchanges(step)))

    @property
    def done(self) -> bool:
        """Whether every step has ended."""
        return not any(contact.jobs for contact in self.contacts)

    def begin(self, index: int, step: Step) -> None:
        """One more step for one vehicle, after those it already has."""
        contact = self.contacts[index]
        contact.jobs.append(_Job(-1, step, Recipes(contact.spec, self._sender(index)).exchanges(step)))

    def receive(self, index: int, data: bytes, now: float) -> None:
        """Bytes of one vehicle."""
        self._now = now
        if self._frames_are_sound and _is_plain_telemetry(data):
            self.contacts[index].messages += 1
            self._heard(index, data, now)
            return
        for message in self._parsers[index].parse_buffer(data) or ():
            if message.get_type().startswith(("BAD_DATA", "UNKNOWN_")):
                continue  # noise, or a spoilt header: what the codec does not know it cannot check either
            self._heard(index, bytes(message.get_msgbuf()), now)
            self._note(index, message, now)

    def step(self, now: float) -> Out:
        """What to send by `now`, (link, bytes) each."""
        self._now = now
        if now + EPSILON_S >= self._next_heartbeat_s:
            self._next_heartbeat_s += HEARTBEAT_S
            if self._beats(now):
                self._beat()
        for index, contact in enumerate(self.contacts):
            if contact.first_heard_s is not None:
                self._ask_for_streams(index, contact, now)
                self._work(contact, now)
        out, self._outbox = self._outbox, []
        return out

    def unfinished(self) -> list[StepFailure]:
        """The steps that have not ended yet, as failures."""
        return [
            StepFailure(job.index, job.step.chosen, contact.spec.sysid, self._now, "did not end")
            for contact in self.contacts
            for job in contact.jobs
        ]

    # -- in ----------------------------------------------------------------------------------------------

    def _note(self, index: int, message: Any, now: float) -> None:
        contact = self.contacts[index]
        contact.messages += 1
        kind = message.get_type()
        if message.get_srcSystem() != contact.spec.sysid:
            return  # a radio's own report
        if kind == "HEARTBEAT":
            contact.heard_s = now
            if contact.first_heard_s is None:
                contact.first_heard_s = now
        elif kind == "STATUSTEXT":
            contact.heard.note(message)
        elif kind == "GLOBAL_POSITION_INT":
            contact.telemetry_s = now
        contact.progress.note(message, now)
        if contact.jobs and contact.jobs[0].began_s is not None:
            job = contact.jobs[0]
            if job.exchanges and job.retry_s is None and job.exchanges[0].outcome is None:
                job.exchanges[0].receive(message, now)
                self._work(contact, now)

    # -- out ---------------------------------------------------------------------------------------------

    def _sender(self, index: int) -> Callable[[Any], None]:
        link = self.contacts[index].spec.link

        def send(message: Any) -> None:
            frame = bytes(message.pack(self._codecs[link]))
            self._outbox.append((link, frame))
            self._heard(index, frame, self._now)

        return send

    def _beats(self, now: float) -> bool:
        past = [on for at_s, on in self._heartbeats if at_s <= now + EPSILON_S]
        return past[-1] if past else True

    def _beat(self) -> None:
        for link in self._links:
            message = mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
            )
            frame = bytes(message.pack(self._codecs[link]))
            self._outbox.append((link, frame))
            for index, contact in enumerate(self.contacts):
                if contact.spec.link == link:
                    self._heard(index, frame, self._now)

    def _ask_for_streams(self, index: int, contact: Contact, now: float) -> None:
        quiet_s = now - max(contact.telemetry_s, contact.streams_asked_s)
        if quiet_s < STREAMS_ASKED_S or not self._beats(now):
            return
        contact.streams_asked_s = now
        self._sender(index)(
            mavlink.MAVLink_request_data_stream_message(
                contact.spec.sysid, 1, mavlink.MAV_DATA_STREAM_ALL, STREAM_HZ, 1
            )
        )

    def _work(self, contact: Contact, now: float) -> None:
        """Carry the vehicle's present step on, and begin the next ones."""
        while contact.jobs and self._carry_on(contact, contact.jobs[0], now):
            contact.jobs.popleft()

    def _carry_on(self, contact: Contact, job: _Job, now: float) -> bool:
        """True if the step has ended."""
        assert contact.first_heard_s is not None
        if job.began_s is None:
            if now + EPSILON_S < max(job.step.at_s, contact.first_heard_s + SETTLED_S):
                return False
            job.began_s = now
            job.exchanges[0].begin(now)
        exchange = job.exchanges[0]
        if job.retry_s is not None:
            if now < job.retry_s:
                return False
            job.retry_s = None
            exchange.begin(now)
        exchange.tick(now)
        if exchange.outcome is None:
            return now - job.began_s >= job.step.timeout_s and self._failed(contact, job, now, job.answer)
        if exchange.outcome.accepted:
            return self._accepted(contact, job, now)
        return self._refused(contact, job, now, exchange.outcome.text)

    def _accepted(self, contact: Contact, job: _Job, now: float) -> bool:
        job.exchanges.pop(0)
        if job.exchanges:
            job.exchanges[0].begin(now)
            return False
        if job.step.expect == "refused":
            return self._failed(contact, job, now, "was accepted, and should have been refused")
        return True

    def _refused(self, contact: Contact, job: _Job, now: float, text: str) -> bool:
        assert job.began_s is not None
        if job.step.expect != "accepted":
            return True
        job.answer = text + (f"; it said {contact.texts[-1]!r}" if contact.texts else "")
        if now - job.began_s >= job.step.timeout_s:
            return self._failed(contact, job, now, job.answer)
        job.retry_s = now + RETRY_S
        return False

    def _failed(self, contact: Contact, job: _Job, now: float, text: str) -> bool:
        self.failures.append(StepFailure(job.index, job.step.chosen, contact.spec.sysid, now, text))
        return True


def _is_plain_telemetry(data: bytes) -> bool:
    """Whether these are one whole frame, of a kind that nobody here waits for."""
    whole = len(data) >= HEADER2_BYTES and data[0] == MAVLINK2 and len(data) == data[1] + FRAME_BYTES
    return whole and int.from_bytes(data[7:10], "little") not in AWAITED


def _parser() -> mavlink.MAVLink:
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    return parser

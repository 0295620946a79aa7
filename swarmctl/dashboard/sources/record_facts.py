"""The messages of `run.mcap` as facts for a timeline. Pure.

Only what is shown is decoded, so an hour is read in seconds. What happened is taken from the record; no agent
decides again. So the records of other versions, which decided otherwise, are shown as they were flown.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from swarmctl.core.events import (
    LinkLost,
    LinkRestored,
    MissionAccepted,
    MissionFailed,
    ObservationsReceived,
    Publish,
    SwapMission,
    WeightsChanged,
)
from swarmctl.core.frames import IntentShared, MemberShared, StateShared
from swarmctl.core.observation import Observation
from swarmctl.core.vehicle import VehicleState
from swarmctl.dashboard.model import Timeline
from swarmctl.report import foxglove
from swarmctl.report.foxglove import LogLevel
from swarmctl.report.record import EFFECTS, EVENTS
from swarmctl.report.record_file import StoredMessage

MAX_HEARD_AGE_S = 5.0
"""age above which an intent came in another vehicle's answer, not from its sender [s]"""
_TAG = b'"type":"'


class _Telemetry(msgspec.Struct, tag="TelemetryReceived"):
    """`core.events.TelemetryReceived` without the contents of messages."""

    state: VehicleState
    neighbours: tuple[tuple[int, msgspec.Raw], ...] = ()
    intents: tuple[tuple[int, float, msgspec.Raw], ...] = ()


class _Log(msgspec.Struct):
    level: int
    message: str
    name: str


def _decoder(kind: type[Any], field: str) -> Callable[[bytes], Any]:
    record = msgspec.defstruct("Record", [(field, kind), ("vehicle", str, "")])
    return msgspec.json.Decoder(record).decode


_FACTS: dict[bytes, tuple[Callable[[bytes], Any], str]] = {
    **{
        str(kind.__struct_config__.tag).encode(): (_decoder(kind, "event"), "event")
        for kind in (
            _Telemetry,
            ObservationsReceived,
            MissionAccepted,
            MissionFailed,
            LinkLost,
            LinkRestored,
            WeightsChanged,
        )
    },
    **{
        str(kind.__struct_config__.tag).encode(): (_decoder(kind, "effect"), "effect")
        for kind in (Publish, SwapMission)
    },
}
"""kind of event or effect -> its decoder and field; other kinds show nothing"""
_log = msgspec.json.Decoder(_Log)


def _kind_of(topic: str) -> str:
    if topic == foxglove.LOG:
        return "log"
    return "fact" if topic in (EVENTS, EFFECTS) else ""


class RecordFacts:
    """The reader of one record's messages into a timeline."""

    def __init__(self, timeline: Timeline, first_ns: int) -> None:
        self._timeline = timeline
        self._first_ns = first_ns
        self._kinds: dict[str, str] = {}
        """what the messages of a topic are; empty: nothing that is shown"""
        self._uav = {vehicle.name: uav for uav, vehicle in timeline.vehicles.items()}

    def fold(self, message: StoredMessage) -> None:
        """Fold a message, if it shows something. Raises ValueError for a damaged message."""
        kind = self._kinds.get(message.topic)
        if kind is None:
            kind = self._kinds[message.topic] = _kind_of(message.topic)
        if kind == "":
            return
        time_s = (message.log_time_ns - self._first_ns) / 1e9
        if kind == "log":
            log = _log.decode(message.data)
            if log.level >= LogLevel.INFO:
                self._timeline.note(log.name, time_s, log.message)
            return
        begin = message.data.find(_TAG) + len(_TAG)
        found = _FACTS.get(message.data[begin : message.data.find(b'"', begin)])
        if found is None:
            return
        decode, field = found
        record = decode(message.data)
        uav = self._uav.get(record.vehicle)
        if uav is not None:
            self._fold(uav, time_s, getattr(record, field))

    def _fold(self, uav: int, time_s: float, fact: object) -> None:  # noqa: PLR0912, one kind a line
        timeline = self._timeline
        match fact:
            case _Telemetry(state, neighbours, intents):
                timeline.telemetry(uav, time_s, state)
                for other, _ in neighbours:
                    timeline.heard(uav, other, time_s)
                for other, age_s, _ in intents:
                    if age_s < MAX_HEARD_AGE_S:
                        timeline.heard(uav, other, time_s, is_intent=True)
            case ObservationsReceived(items):
                timeline.learned(uav, time_s, items)
            case Publish(StateShared() as state):
                timeline.shared(uav, time_s, state, has_telemetry=True)
            case Publish(Observation() as observation):
                timeline.learned(uav, time_s, (observation,))
            case Publish(MemberShared() as member):
                timeline.member(uav, time_s, member)
            case Publish(IntentShared() as intent):
                timeline.intent(uav, time_s, intent, is_route=False)
            case SwapMission(mission):
                timeline.planned(uav, time_s, mission)
            case MissionAccepted(plan_id):
                timeline.accepted(uav, time_s, plan_id)
            case MissionFailed(plan_id, _, reason):
                timeline.not_accepted(uav, time_s, plan_id, reason)
            case WeightsChanged(_, w, strength, reach):
                timeline.weights(uav, time_s, w, strength, reach)
            case LinkLost(age_s):
                timeline.link_lost(uav, time_s, age_s)
            case LinkRestored():
                timeline.link_restored(uav, time_s)

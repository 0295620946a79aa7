"""A digest of a run: its commands by the chain, with vehicles' answers and states by the tlogs. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects import Unsupported, dialect_for
from swarmctl.mavlink.protocol.codec import Message, decode, logged_frames
from swarmctl.mavlink.protocol.command import name_of
from swarmctl.mavlink.telemetry.presence import AUTOPILOT_COMPID, is_armed
from swarmctl.report.evidence.chain import CheckedChain
from swarmctl.report.evidence.commands import CHANGED_PART, COMMANDS, UNRECORDED, command_of

_UPLOADS = ("MISSION_COUNT", "MISSION_WRITE_PARTIAL_LIST", "MISSION_CLEAR_ALL")
_PARAMETERS = ("PARAM_SET", "PARAM_REQUEST_READ")
_EXPECTS_ANSWER = frozenset({*COMMANDS, *_UPLOADS, *_PARAMETERS})
_GOES_ON = frozenset({"IN_PROGRESS", "INVALID_SEQUENCE"})
"""answers before the last one: ArduPilot answers INVALID_SEQUENCE to a repeated item, and continues"""
_NO_REFUSAL = _GOES_ON | {"ACCEPTED", "PARAM_VALUE"}
_READ = frozenset(
    {"COMMAND_ACK", "MISSION_ACK", "PARAM_VALUE", "HEARTBEAT", "MISSION_CURRENT", "EXTENDED_SYS_STATE"}
)
"""vehicles' messages that the digest reads"""


@dataclass(slots=True)
class CommandRow:
    """The digest of all commands or messages to one vehicle that have the same name."""

    sent: int = 0
    by_others: int = 0
    """number of messages from other stations, included in `sent`"""
    answers: Counter[str] = field(default_factory=Counter)
    unanswered: int = 0
    effects: Counter[str] = field(default_factory=Counter)
    """first change of the part of the vehicle's state that the command changes -> number of commands"""

    @property
    def refused(self) -> int:
        return sum(n for answer, n in self.answers.items() if answer not in _NO_REFUSAL)


@dataclass(slots=True)
class VehicleDigest:
    """The digest of the messages to and from one vehicle, in the order of the wire."""

    rows: dict[str, CommandRow] = field(default_factory=dict)
    unasked: Counter[str] = field(default_factory=Counter)
    """changes of mode and arming without a recorded command, except disarmings on the ground"""
    n_disarmed_on_ground: int = 0
    """number of disarmings on the ground without a recorded command"""
    _state: dict[str, Any] = field(default_factory=dict)
    _asked: dict[str, CommandRow] = field(default_factory=dict)
    """part of the state -> row of the last command to change this part"""
    _parameters: set[str] = field(default_factory=set)
    """names of parameters that were set or requested"""

    def sent(self, what: Mapping[str, Any]) -> None:
        """Count a recorded command or message."""
        name = command_of(what)
        row = self.rows.setdefault(name, CommandRow())
        row.sent += 1
        row.by_others += "by" in what
        row.unanswered += str(what.get("message")) in _EXPECTS_ANSWER
        self._parameters.add(str(what.get("param_id")))
        if name in CHANGED_PART:
            self._asked[CHANGED_PART[name]] = row

    def received(self, message: Message) -> None:
        """Count a vehicle's answer or change of state."""
        match message.get_type():
            case "COMMAND_ACK":
                command = name_of("MAV_CMD", int(message.command))
                self._answered((command,), name_of("MAV_RESULT", int(message.result)))
            case "MISSION_ACK":
                result = name_of("MAV_MISSION_RESULT", int(message.type))
                self._answered(_UPLOADS, result.removeprefix("MAV_MISSION_"))
            case "PARAM_VALUE" if message.param_id in self._parameters:
                self._answered(_PARAMETERS, "PARAM_VALUE")
            case "HEARTBEAT":
                self._changed("mode", _mode(message))
                self._changed("armed", is_armed(message))
            case "MISSION_CURRENT" if message.seq != 0xFFFF:
                self._changed("mission_seq", int(message.seq))
            case "EXTENDED_SYS_STATE":
                self._changed("landed", int(message.landed_state))

    def _answered(self, names: Iterable[str], answer: str) -> None:
        rows = [self.rows[name] for name in names if name in self.rows]
        for row in ([row for row in rows if row.unanswered > 0] or rows)[:1]:
            row.answers[answer] += 1
            row.unanswered -= answer not in _GOES_ON and row.unanswered > 0

    def _changed(self, part: str, to: Any) -> None:
        before, self._state[part] = self._state.get(part), to
        if to != before and (row := self._asked.pop(part, None)) is not None:
            row.effects[str(to)] += 1
        elif before not in (to, None) and part in ("mode", "armed"):
            self.unasked[f"{part} {to}"] += 1
        if self._state.get("landed") == Landed.ON_GROUND:
            # The landing may be reported before or after the disarming.
            self.n_disarmed_on_ground += self.unasked.pop("armed False", 0)


def _mode(heartbeat: Message) -> str:
    try:
        dialect = dialect_for(int(heartbeat.autopilot), int(heartbeat.type))
    except Unsupported:
        return str(heartbeat.custom_mode)
    return dialect.mode_name(int(heartbeat.custom_mode))


def digest(checked: CheckedChain, tlogs: Mapping[str, bytes]) -> dict[str, VehicleDigest]:
    """Return the digests by vehicle, in the order of the first commands.

    `tlogs`: content of the tlogs by vehicle; a vehicle without a tlog has neither answers nor effects.
    """
    commands: dict[str, list[Mapping[str, Any]]] = {}
    for entry in checked.entries:
        if entry.kind == "command":
            commands.setdefault(entry.vehicle or "all", []).append(entry.what)
    sysids = checked.opened.vehicles
    return {
        vehicle: _digest(iter(sent), sysids.get(vehicle, 0), tlogs.get(vehicle, b""))
        for vehicle, sent in commands.items()
    }


def _digest(commands: Iterator[Mapping[str, Any]], sysid: int, tlog: bytes) -> VehicleDigest:
    found = VehicleDigest()
    for frame in logged_frames(tlog):
        is_answer = (frame.sysid, frame.compid) == (sysid, AUTOPILOT_COMPID) and frame.name in _READ
        is_command = frame.sysid != sysid and frame.name not in UNRECORDED
        message = decode(frame) if is_answer or is_command else None
        if message is not None and is_answer:
            found.received(message)
        elif getattr(message, "target_system", 0) == sysid:
            what = next(commands, None)
            if what is None:
                break
            found.sent(what)
    # A tlog may end early: its last second is lost with the process.
    for what in commands:
        found.sent(what)
    return found

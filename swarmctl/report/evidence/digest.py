"""A digest of the evidence chain: commands by vehicle, answers and effects; people's actions. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from swarmctl.core.vehicle import Landed
from swarmctl.report.evidence.chain import Content, Entry
from swarmctl.report.evidence.transfer import ANNOUNCEMENTS

_ITEMS = "MISSION_ITEM_INT"
_UPLOADS = (_ITEMS, "MISSION_COUNT", "MISSION_WRITE_PARTIAL_LIST", "MISSION_CLEAR_ALL")
_PARAMETERS = ("PARAM_SET", "PARAM_REQUEST_READ")
_NO_MODE = ""
"""the mode of a vehicle before its first heartbeat"""
_DISARMED = "armed False"
_CHANGED_PART = {
    "COMPONENT_ARM_DISARM": "armed",
    "DO_SET_MODE": "mode",
    "SET_MODE": "mode",
    "MISSION_START": "mode",
    "NAV_RETURN_TO_LAUNCH": "mode",
    "NAV_LAND": "mode",
    "DO_SET_MISSION_CURRENT": "mission_seq",
    "MISSION_SET_CURRENT": "mission_seq",
}
"""command -> the part of a vehicle's state that changes when the vehicle follows the command"""
_EXPECTS_ANSWER = frozenset({_ITEMS, "MISSION_CLEAR_ALL", *_PARAMETERS})
"""messages, besides commands, that count as unanswered until an acknowledgement"""
_NO_REFUSAL = frozenset({"ACCEPTED", "IN_PROGRESS", "PARAM_VALUE", "INVALID_SEQUENCE"})
"""ArduPilot answers INVALID_SEQUENCE to a repeated mission item, and continues the transfer"""


@dataclass(slots=True)
class CommandRow:
    """The digest of all commands or messages to one vehicle that have the same name."""

    vehicle: str
    command: str
    sent: int = 0
    answers: Counter[str] = field(default_factory=Counter)
    unanswered: int = 0
    effects: Counter[str] = field(default_factory=Counter)
    """first matching change of the vehicle's state after a command -> number of commands"""
    is_in_transfer: bool = False
    """True from an entry with mission items until the next announcement: one transfer counts once"""
    by_others: int = 0
    """number of messages from other stations, included in `sent`"""

    @property
    def refused(self) -> int:
        return sum(n for answer, n in self.answers.items() if answer not in _NO_REFUSAL)


@dataclass(slots=True)
class Digest:
    """The digest of a whole chain."""

    rows: list[CommandRow] = field(default_factory=list)
    unasked: dict[str, Counter[str]] = field(default_factory=dict)
    """changes of mode and arming without a recorded command, by vehicle, except disarmings on the ground"""
    n_disarmed_on_ground: Counter[str] = field(default_factory=Counter)
    """number of disarmings on the ground without a recorded command, by vehicle"""
    people: list[Entry] = field(default_factory=list)
    """entries of waivers and operators' actions"""


def digest(entries: Iterable[Entry]) -> Digest:
    """Return the digest of the entries of an unbroken chain."""
    found = Digest()
    rows: dict[tuple[str, str], CommandRow] = {}
    asked: dict[tuple[str, str], CommandRow] = {}
    """(vehicle, part of its state) -> row of the last command to change this part"""
    on_ground: dict[str, bool] = {}
    for entry in entries:
        vehicle, what = entry["vehicle"] or "all", entry["what"]
        match entry["kind"]:
            case "command":
                _count_command(rows, asked, vehicle, what)
            case "acknowledgement":
                _count_answer(rows, vehicle, what)
            case "effect":
                _count_change(asked, found, vehicle, what)
                _move_disarming(found, on_ground, vehicle, what)
            case "waiver" | "operator":
                found.people.append(entry)
    vehicles = list(dict.fromkeys(vehicle for vehicle, _ in rows))
    found.rows = sorted(rows.values(), key=lambda row: vehicles.index(row.vehicle))
    return found


def _count_command(
    rows: dict[tuple[str, str], CommandRow],
    asked: dict[tuple[str, str], CommandRow],
    vehicle: str,
    what: Content,
) -> None:
    name = str(what.get("command", what.get("message", "?")))
    row = rows.setdefault((vehicle, name), CommandRow(vehicle, name))
    items = rows.get((vehicle, _ITEMS))
    if name in ANNOUNCEMENTS and items is not None:
        items.is_in_transfer = False
    if row.is_in_transfer:
        return  # more items of the same transfer
    row.is_in_transfer = name == _ITEMS
    row.sent += 1
    row.unanswered += "command" in what or name in _EXPECTS_ANSWER
    row.by_others += "by" in what
    if name in _CHANGED_PART:
        asked[vehicle, _CHANGED_PART[name]] = row


def _count_answer(rows: dict[tuple[str, str], CommandRow], vehicle: str, what: Content) -> None:
    answer = str(what.get("result", what.get("message", "?")))
    message = what.get("message")
    names = {"MISSION_ACK": _UPLOADS, "PARAM_VALUE": _PARAMETERS}.get(
        str(message), (str(what.get("command", message)),)
    )
    answered = [row for name in names if (row := rows.get((vehicle, name))) is not None]
    waiting = [row for row in answered if row.unanswered > 0]
    for row in (waiting or answered)[:1]:
        row.answers[answer] += 1
        row.unanswered -= answer != "IN_PROGRESS" and row.unanswered > 0


def _move_disarming(found: Digest, on_ground: dict[str, bool], vehicle: str, what: dict[str, Any]) -> None:
    """Move a disarming from `unasked` to `n_disarmed_on_ground` if the vehicle is on the ground.

    Telemetry may report the landing before or after the disarming.
    """
    part, to = what.get("changed"), what.get("to")
    if part == "landed":
        on_ground[vehicle] = to == Landed.ON_GROUND.name
    unasked = found.unasked.get(vehicle, Counter())
    if part in ("landed", "armed") and on_ground.get(vehicle) and unasked[_DISARMED]:
        found.n_disarmed_on_ground[vehicle] += unasked.pop(_DISARMED)
        if not unasked:
            del found.unasked[vehicle]


def _count_change(
    asked: dict[tuple[str, str], CommandRow], found: Digest, vehicle: str, what: dict[str, Any]
) -> None:
    part = str(what.get("changed"))
    text = f"{part} {what.get('to')}"
    row = asked.pop((vehicle, part), None)
    if row is not None:
        row.effects[text] += 1
    elif part in ("mode", "armed") and what.get("from") != _NO_MODE:
        found.unasked.setdefault(vehicle, Counter())[text] += 1

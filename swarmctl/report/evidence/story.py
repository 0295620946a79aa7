"""Entries from an agent's events and effects: state changes, operators' requests, decisions. Pure."""

from __future__ import annotations

from dataclasses import asdict, astuple
from typing import Any

from swarmctl.core import events as ev
from swarmctl.core.mission import FlightPlan
from swarmctl.core.vehicle import VehicleState
from swarmctl.report.evidence.chain import canonical, sha256
from swarmctl.report.evidence.transfer import NewEntry

RECORDED_STATE_FIELDS = ("mode", "armed", "landed", "mission_seq")
"""fields of VehicleState; each change of such a field makes an entry"""


def state_changes(before: VehicleState, after: VehicleState) -> list[NewEntry]:
    """Return an entry for each change of a field of RECORDED_STATE_FIELDS."""
    changes = {name: (getattr(before, name), getattr(after, name)) for name in RECORDED_STATE_FIELDS}
    return [
        ("effect", {"changed": name, "from": _enum_name(old), "to": _enum_name(new)})
        for name, (old, new) in changes.items()
        if old != new
    ]


def event_entries(event: ev.Event, effects: list[ev.Effect]) -> list[NewEntry]:
    """Return entries for an operator's request with its answer, an event of the flight, and decisions."""
    entries: list[NewEntry] = [*_request(event, effects), *_flight_event(event)]
    for effect in effects:
        match effect:
            case ev.Command(order):
                entries.append(("note", {"decided": str(order)}))
            case ev.SwapMission(plan_id=plan_id, plan=plan):
                entries.append(("note", {"decided": "mission", "plan": plan_id, **_plan(plan)}))
            case ev.Release():
                entries.append(
                    ("note", {"decided": "released: a pilot or another station flies the vehicle"})
                )
    return entries


def _plan(plan: FlightPlan) -> dict[str, Any]:
    """Return the number of waypoints before the landing, and the hash of the plan."""
    return {"waypoints": len(plan.track), "sha256": sha256(canonical(asdict(plan)))}


def _request(event: ev.Event, effects: list[ev.Effect]) -> list[NewEntry]:
    what: dict[str, Any]
    match event:
        case ev.OperatorCommand(order=order, command=int(), ignore=ignored):
            what = {"asks": str(order), **({"past": ignored} if ignored else {})}
        case ev.WeightsChanged(w=w, strength=strength):
            what = {"asks": "weights", "w": w, "firing_strength": strength and astuple(strength)}
        case _:
            return []
    answers = [effect.answer for effect in effects if isinstance(effect, ev.Answer)]
    outcome = {"outcome": answers[0].outcome, "note": answers[0].note} if answers else {}
    return [("operator", {**what, **outcome})]


def _flight_event(event: ev.Event) -> list[NewEntry]:
    match event:
        case ev.Restarted(reason=reason):
            return [("note", {"taken over": not reason, **({"why": reason} if reason else {})})]
        case ev.MissionAccepted(plan_id):
            return [("note", {"ended": "mission", "plan": plan_id})]
        case ev.MissionFailed(plan_id, flying, reason):
            return [("note", {"failed": "mission", "plan": plan_id, "flying": flying, "why": reason})]
        case ev.OrderDone(order):
            return [("note", {"ended": str(order)})]
        case ev.OrderFailed(order, reason):
            return [("note", {"failed": str(order), "why": reason})]
        case ev.LaunchPostponed(reason):
            return [("note", {"put off": "launch", "why": reason})]
        case ev.LinkLost(age_s):
            return [("note", {"link": "lost", "age_s": round(age_s, 3)})]
        case ev.LinkRestored():
            return [("note", {"link": "restored"})]
        case ev.Rebooted():
            return [("note", {"vehicle": "has rebooted"})]
    return []


def _enum_name(value: Any) -> Any:
    return value.name if hasattr(value, "name") else value

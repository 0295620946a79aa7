"""Vehicles' answers to an operator's commands, as lines."""

from __future__ import annotations

from collections.abc import Mapping

from swarmctl.core.messages import CommunicationRange, VehicleAnswer
from swarmctl.core.threat import FiringStrength


def order_line(order: str, answer: VehicleAnswer) -> str:
    """Return a vehicle's answer to an order as a line."""
    how = {"taken": "ordered", "unconfirmed": "not confirmed"}.get(answer.outcome, "not ordered")
    return f"{answer.name}: {order} {how}" + (f": {answer.note}" if answer.note else "")


def weights_line(
    w: float | None,
    strength: FiringStrength | None,
    answer: VehicleAnswer,
    reach: CommunicationRange | None = None,
    behaviours: Mapping[str, float] | None = None,
) -> str:
    """Return a vehicle's answer to new weights or a new range of communication as a line."""
    if answer.outcome != "taken":
        how = "not confirmed" if answer.outcome == "unconfirmed" else "not changed"
        return f"{answer.name}: weights {how}: {answer.note}"
    parts = [] if w is None else [f"w = {w:g}"]
    if strength is not None:
        fs = (strength.direct, strength.first_neighbour, strength.second_neighbour)
        parts.append("firing strengths " + ", ".join(f"{value:g}" for value in fs))
    told = [f"{' and '.join(parts)} from plan {answer.from_plan} on"] if parts else []
    if reach is not None:
        told.append(f"range of communication {reach} from now on")
    if behaviours:
        values = ", ".join(f"{name} = {weight:g}" for name, weight in behaviours.items())
        told.append(f"behaviours of the group {values} from now on")
    return f"{answer.name}: {'; '.join([*told, *filter(None, [answer.note])])}"

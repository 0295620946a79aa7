"""Nothing is heard of a vehicle, and nothing that it is sent arrives.

What it does then was decided and set on it before the take-off (`preflight.policy`); the ground station can
only say so. If it has begun to when it is heard again it is let go (`taken_over`): a failsafe is not fought.
"""

from __future__ import annotations

from typing import Literal

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts
from swarmctl.core.section import Section
from swarmctl.core.vehicle import ModeRole

NAME = "lost_link"

_DOES = {
    "hold": "after {:g} s it holds",
    "return": "after {:g} s it returns",
    "land": "after {:g} s it lands where it is",
}
_GOES_ON: dict[ModeRole, str] = {
    "mission": "it flies its mission to the end",
    "hold": "it holds on in mode {}",
    "return": "it goes on home in mode {}",
    "land": "it goes on down in mode {}",
    "other": "it stays in mode {}",
    "": "it goes on with what it does",
}
"""By what the mode is for in which it was heard last."""


class Params(Section):
    """The policy that its parameters were checked against."""

    does: Literal["return", "land", "hold", "continue"] = "continue"
    after_s: float = 10.0
    """without the ground station's heartbeat, by its own clock"""


def evaluate(params: Params, _memory: None, facts: FailsafeFacts, _now: float) -> tuple[None, Demand | None]:
    if not (facts.lost and facts.in_flight):
        return None, None
    vehicle = facts.vehicle
    if params.does in ("continue", vehicle.mode_role):
        does = _GOES_ON[vehicle.mode_role].format(vehicle.mode)
    else:
        does = _DOES[params.does].format(params.after_s)
    return None, Demand(
        DemandKind.WARN,
        f"nothing is heard of it, and no order reaches it; by preflight.policy.lost_link {does}",
    )

"""Lost link: no telemetry arrives from a vehicle, and orders may not reach the vehicle.

The vehicle's reaction was set before the take-off (`preflight.policy`), and this rule only announces it. If
telemetry returns after the vehicle's own failsafe began, the vehicle is released (`taken_over`).
"""

from __future__ import annotations

from typing import Literal

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts
from swarmctl.core.section import Section
from swarmctl.core.vehicle import ModeRole

NAME = "lost_link"

_REACTIONS = {
    "hold": "holds after {:g} s",
    "return": "returns after {:g} s",
    "land": "lands where it is after {:g} s",
}
_CONTINUES: dict[ModeRole, str] = {
    "mission": "flies its mission to the end",
    "hold": "keeps holding in mode {}",
    "return": "continues its return in mode {}",
    "land": "continues its landing in mode {}",
    "setpoints": "leaves mode {} by its own rule for set-points that stop",
    "other": "stays in mode {}",
    "": "continues as before",
}
"""Texts by the role of the last mode received."""


class Params(Section):
    """The lost-link policy with which preflight compared the vehicle's parameters."""

    does: Literal["return", "land", "hold", "continue"] = "continue"
    after_s: float = 10.0
    """time without the ground station's heartbeat until the reaction, by the vehicle's clock [s]"""


def evaluate(params: Params, _memory: None, facts: FailsafeFacts, _now: float) -> tuple[None, Demand | None]:
    if not (facts.lost and facts.in_flight):
        return None, None
    vehicle = facts.vehicle
    if params.does in ("continue", vehicle.mode_role) or vehicle.mode_role == "setpoints":
        does = _CONTINUES[vehicle.mode_role].format(vehicle.mode)
    else:
        does = _REACTIONS[params.does].format(params.after_s)
    return None, Demand(
        DemandKind.WARN,
        f"no telemetry arrives, and orders may not reach the vehicle; it {does} (preflight.policy.lost_link)",
    )

"""The phases of a flight, and the changes from phase to phase that may happen."""

from __future__ import annotations

from enum import StrEnum


class Phase(StrEnum):
    WAITING = "waiting"
    """not ready yet"""
    UPLOADING = "uploading"
    """ready; the mission for the launch is being planned or uploaded"""
    STANDBY = "standby"
    """on the ground with a verified mission"""
    LAUNCHING = "launching"
    FLYING = "flying"
    FORMATION = "formation"
    """flies to its place in its group, by set-points"""
    LANDING = "landing"
    """in the goal cell: the vehicle flies to its landing spot, waits above the spot, or descends"""
    HOLDING = "holding"
    """holding by an order or a failsafe rule, or until its return"""
    LEAVING = "leaving"
    """returning, or landing where it is, by an order or a failsafe rule"""
    RELEASED = "released"
    """taken over by a pilot, the autopilot's failsafe or another station; the agent sends no own orders"""
    DONE = "done"
    FAILED = "failed"


ENDED = frozenset({Phase.RELEASED, Phase.DONE, Phase.FAILED})
ON_GROUND = frozenset({Phase.WAITING, Phase.UPLOADING, Phase.STANDBY})
IN_FLIGHT = frozenset({Phase.FLYING, Phase.FORMATION, Phase.LANDING, Phase.HOLDING, Phase.LEAVING})
PAST_PLANNING = ENDED | {Phase.LANDING, Phase.HOLDING, Phase.LEAVING}
PLANNING = frozenset({Phase.UPLOADING, Phase.STANDBY, Phase.FLYING, Phase.FORMATION})
EN_ROUTE = frozenset({Phase.FLYING, Phase.FORMATION})

TRANSITIONS: dict[Phase, frozenset[Phase]] = {
    Phase.WAITING: frozenset({Phase.UPLOADING, Phase.RELEASED, Phase.DONE}),
    Phase.UPLOADING: ENDED | {Phase.STANDBY, Phase.WAITING},
    Phase.STANDBY: ENDED | {Phase.LAUNCHING, Phase.WAITING},
    Phase.LAUNCHING: frozenset(
        {
            Phase.FLYING,
            Phase.LANDING,
            Phase.LEAVING,
            Phase.STANDBY,
            Phase.WAITING,
            Phase.RELEASED,
            Phase.FAILED,
        }
    ),
    Phase.FLYING: ENDED | {Phase.FORMATION, Phase.LANDING, Phase.HOLDING, Phase.LEAVING},
    Phase.FORMATION: ENDED | {Phase.FLYING, Phase.HOLDING, Phase.LEAVING},
    Phase.LANDING: ENDED | {Phase.HOLDING, Phase.LEAVING},
    Phase.HOLDING: ENDED | {Phase.FLYING, Phase.LANDING, Phase.LEAVING},
    Phase.LEAVING: ENDED | {Phase.HOLDING},
    Phase.RELEASED: frozenset({Phase.DONE}),  # it landed at its goal
    Phase.DONE: frozenset(),
    Phase.FAILED: frozenset(),
}
"""The phases that may follow each phase, besides the phase itself.

A reboot or a new start of the program leads from the ground back to WAITING, and a cancelled launch back to
STANDBY. A new start during the launch may find the vehicle in its goal cell.
"""


class IllegalTransition(Exception):
    """A change of phase that no rule allows: a bug."""


def changed(before: Phase, after: Phase) -> Phase:
    """Return the new phase. Raises IllegalTransition if it may not follow the old one."""
    if after is not before and after not in TRANSITIONS[before]:
        raise IllegalTransition(f"phase {before} cannot be followed by {after}")
    return after

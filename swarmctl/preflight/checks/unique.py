"""Check `unique`: no other sender has the system id, and no other vehicle has the same autopilot."""

from __future__ import annotations

from swarmctl.mavlink.events import Identity
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "unique"
WAIVABLE = False


def check(facts: PreflightFacts) -> Finding:
    wanted = "one vehicle at one system id"
    if facts.sysid_conflict:
        return Finding(False, facts.sysid_conflict, wanted, "give each vehicle its own system id")
    same_id = [other.spec.name for other in facts.others if other.spec.sysid == facts.spec.sysid]
    if same_id:
        found = f"system {facts.spec.sysid}, as {', '.join(same_id)}"
        return Finding(False, found, wanted, "give each vehicle its own sysid")
    twins = [other.spec.name for other in facts.others if _same_board(facts, other.identity)]
    if twins:
        remedy = "two URLs lead to one vehicle; correct one of them"
        return Finding(False, f"the same autopilot as {', '.join(twins)}, by its uid", wanted, remedy)
    return Finding(True, f"system {facts.spec.sysid}, no other vehicle", wanted)


def _same_board(facts: PreflightFacts, other: Identity | None) -> bool:
    """Return whether two vehicles have the same board, by AUTOPILOT_VERSION.uid2; all zeros mean unknown."""
    mine = facts.identity
    if mine is None or other is None:
        return False
    return any(mine.uid2) and mine.uid2 == other.uid2 and not _is_board_type(mine.uid2)


def _is_board_type(uid2: bytes) -> bool:
    """Return whether a uid names a type of board, not one board.

    PX4's Linux boards (VOXL 2, Raspberry Pi) report two bytes of the processor's architecture, then a text
    for the type of board (BOARD_OVERRIDE_UUID).
    """
    return uid2[2:].isalnum()

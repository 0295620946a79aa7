"""Nobody else is at its system id, and no two vehicles are the same autopilot."""

from __future__ import annotations

from swarmctl.mavlink.events import Identity
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "unique"
WAIVABLE = False


def check(facts: PreflightFacts) -> Finding:
    wanted = "one vehicle at one system id"
    if facts.conflict:
        return Finding(False, facts.conflict, wanted, "give each a system id of its own")
    same_id = [other.name for other in facts.others if other.sysid == facts.sysid]
    if same_id:
        return Finding(
            False, f"system {facts.sysid}, as {', '.join(same_id)}", wanted, "give each its own sysid"
        )
    twins = [other.name for other in facts.others if _same_board(facts, other.identity)]
    if twins:
        cure = "two urls lead to one vehicle: correct one"
        return Finding(False, f"the same autopilot as {', '.join(twins)}, by its uid", wanted, cure)
    return Finding(True, f"system {facts.sysid} is its alone", wanted)


def _same_board(facts: PreflightFacts, other: Identity | None) -> bool:
    """By AUTOPILOT_VERSION.uid2, in which zeros tell nothing."""
    mine = facts.identity
    if mine is None or other is None:
        return False
    return any(mine.uid2) and mine.uid2 == other.uid2 and not _names_a_kind(mine.uid2)


def _names_a_kind(uid2: bytes) -> bool:
    """PX4's Linux boards, VOXL 2 or a Raspberry Pi, tell a text (BOARD_OVERRIDE_UUID) that all of their kind
    tell, behind the two bytes of the processor's architecture."""
    return uid2[2:].isalnum()

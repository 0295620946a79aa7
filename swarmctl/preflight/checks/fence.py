"""The fence that is on it is the one of the configuration, and in force."""

from __future__ import annotations

from swarmctl.mavlink.procedures.fence import fence_differences, fence_items
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "fence"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = f"the configuration's fence of {len(facts.fence)} corners, read back equal"
    if facts.fence_items is None:
        return Finding(False, "it could not be read", wanted, "look at its link")
    gaps = fence_differences(fence_items(facts.fence), facts.fence_items)
    if gaps:
        cure = "see why it does not keep the fence; another ground station may have changed it"
        return Finding(False, gaps[0], wanted, cure)
    if facts.fence_failure:
        cure = "see why it does not take DO_FENCE_ENABLE, or boot it anew"
        return Finding(False, facts.fence_failure, wanted, cure)
    return Finding(True, f"{len(facts.fence_items)} corners, as sent", wanted)

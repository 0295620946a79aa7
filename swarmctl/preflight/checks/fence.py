"""Check `fence`: the vehicle has the configured fence, and keeps to it."""

from __future__ import annotations

from swarmctl.mavlink.procedures.fence import fence_differences, fence_items
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "fence"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = f"the configured fence of {len(facts.fence)} corners, read back equal"
    if facts.fence_items is None:
        return Finding(False, "no answer to the download of the fence", wanted, "check its link")
    differences = fence_differences(fence_items(facts.fence), facts.fence_items)
    if differences:
        cure = "find out why it does not keep the fence; another ground station may have changed it"
        return Finding(False, differences[0], wanted, cure)
    if facts.fence_failure:
        cure = "find out why it does not accept DO_FENCE_ENABLE, or reboot it"
        return Finding(False, facts.fence_failure, wanted, cure)
    return Finding(True, f"{len(facts.fence_items)} corners, as sent", wanted)

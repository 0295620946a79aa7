"""Check `fence`: the vehicle stores and enforces the configured fence."""

from __future__ import annotations

from swarmctl.mavlink.procedures.fence import fence_differences, fence_items
from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "fence"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = f"the configured fence of {len(facts.fence)} corners, equal in the read-back"
    if facts.answers.fence_items is None:
        return Finding(False, "no answer to the download of the fence", wanted, "check the vehicle's link")
    differences = fence_differences(fence_items(facts.fence), facts.answers.fence_items)
    if differences:
        remedy = "find out why the vehicle's fence differs; another ground station may have changed the fence"
        return Finding(False, differences[0], wanted, remedy)
    if facts.answers.fence_failure:
        remedy = "find out why the vehicle does not accept DO_FENCE_ENABLE, or reboot the vehicle"
        return Finding(False, facts.answers.fence_failure, wanted, remedy)
    return Finding(True, f"{len(facts.answers.fence_items)} corners, as sent", wanted)

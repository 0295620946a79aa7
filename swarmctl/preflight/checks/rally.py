"""Check `rally`: no rally points, because plans assume a return to the take-off position."""

from __future__ import annotations

from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "rally"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = "no rally points: the vehicle would return to a rally point instead of home"
    if facts.answers.rally_points is None:
        return Finding(False, "no answer to the request for rally points", wanted, "check the vehicle's link")
    if facts.answers.rally_points:
        remedy = "clear the rally points with the program that set them"
        return Finding(False, f"{facts.answers.rally_points} rally points", wanted, remedy)
    return Finding(True, "none", wanted)

"""It has no rally points: it returns to where it took off, as is reckoned with."""

from __future__ import annotations

from swarmctl.preflight.facts import Finding, PreflightFacts

NAME = "rally"
WAIVABLE = True


def check(facts: PreflightFacts) -> Finding:
    wanted = "no rally points, to which it would return instead"
    if facts.rally_points is None:
        return Finding(False, "whether it has some is not known", wanted, "look at its link")
    if facts.rally_points:
        cure = "clear them there, with the program that put them there"
        return Finding(False, f"{facts.rally_points} rally points", wanted, cure)
    return Finding(True, "none", wanted)

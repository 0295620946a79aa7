"""Its parameters say what the policy declares, by the names of its firmware."""

from __future__ import annotations

from collections.abc import Sequence

from swarmctl.preflight.facts import Finding, PreflightFacts
from swarmctl.preflight.policy import RequiredParameter

NAME = "parameters"
WAIVABLE = True
_NOBODY_KNOWS = (
    "fly another version or declare another policy; or see yourself to what it does when its link is lost, "
    "its battery low or its fence breached, and how it returns, and waive this by name"
)


def check(facts: PreflightFacts) -> Finding:
    if facts.no_table:
        return Finding(False, facts.no_table, "parameters that say what `policy` declares", _NOBODY_KNOWS)
    wrong = [w for w in facts.wanted if not w.met_by(facts.parameters)]
    if not wrong:
        return Finding(True, f"{len(facts.wanted)} parameters as declared", "as `preflight.policy` declares")
    return Finding(
        False,
        ", ".join(f"{w.name} {_value(facts, w)}" for w in wrong),
        ", ".join(f"{w.name} {w} ({w.declared})" for w in wrong),
        _cure(facts, wrong),
    )


def _cure(facts: PreflightFacts, wrong: Sequence[RequiredParameter]) -> str:
    """Who can mend it: its owner, this program, or who wrote the configuration."""
    silent = [w.name for w in wrong if w.name not in facts.parameters]
    told = [w for w in wrong if w.name in facts.parameters]
    settable = [w.name for w in told if w.corrected(facts.parameters[w.name]) is not None]
    by_hand = [w.name for w in told if w.name not in settable]
    declared = [w.declared for w in told]
    keys = sorted({text.split(":")[0] for text in declared if text.split(":")[0].isidentifier()})
    texts = [
        f"set {_names(settable)} there, or preflight.set_parameters: true" if settable else "",
        f"set {_names(by_hand)} there yourself" if by_hand else "",
        "or declare another policy" if any(text.startswith("policy.") for text in declared) else "",
        "or correct `wings`" if any(text.startswith("wings.") for text in declared) else "",
        f"or correct {_names(keys)} of the vehicle" if keys else "",
        f"see why it does not tell {_names(silent)}: its link, or a firmware built without" if silent else "",
    ]
    return "; ".join(text for text in texts if text)


def _names(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _value(facts: PreflightFacts, wanted: RequiredParameter) -> str:
    value = facts.parameters.get(wanted.name)
    return "not told" if value is None else f"{value:g}"

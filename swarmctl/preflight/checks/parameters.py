"""Its parameters say what the policy declares, by the names of its firmware."""

from __future__ import annotations

from swarmctl.preflight.facts import Facts, Finding
from swarmctl.preflight.policy import Wanted

NAME = "parameters"
WAIVABLE = True


def check(facts: Facts) -> Finding:
    if facts.no_table:
        return Finding(
            False, facts.no_table, "parameters that say what `policy` declares", "waive it by name"
        )
    wrong = [w for w in facts.wanted if not _is_so(facts, w)]
    if not wrong:
        return Finding(True, f"{len(facts.wanted)} parameters as declared", "as `preflight.policy` declares")
    return Finding(
        False,
        ", ".join(f"{w.name} {_value(facts, w)}" for w in wrong),
        ", ".join(f"{w.name} {w} ({w.declared})" for w in wrong),
        "set them, or preflight.set_parameters: true, or declare another policy",
    )


def _is_so(facts: Facts, wanted: Wanted) -> bool:
    return wanted.name in facts.parameters and wanted.accepts(facts.parameters[wanted.name])


def _value(facts: Facts, wanted: Wanted) -> str:
    value = facts.parameters.get(wanted.name)
    return "not told" if value is None else f"{value:g}"

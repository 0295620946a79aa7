"""Check `parameters`: the vehicle's parameters agree with the configuration, as the firmware names them."""

from __future__ import annotations

from collections.abc import Sequence

from swarmctl.preflight.facts import Finding, PreflightFacts
from swarmctl.preflight.policy import RequiredParameter

NAME = "parameters"
WAIVABLE = True
_WANTED = "parameters as the configuration declares"
_UNSUPPORTED = (
    "use a supported version or declare another policy; or set the vehicle's return and its reactions to a "
    "lost link, a low battery and a fence breach by hand, and waive this check"
)


def check(facts: PreflightFacts) -> Finding:
    if facts.no_table_because:
        return Finding(False, facts.no_table_because, _WANTED, _UNSUPPORTED)
    wrong = [r for r in facts.required_parameters if not r.met_by(facts.answers.parameters)]
    if not wrong:
        return Finding(True, f"{len(facts.required_parameters)} parameters as declared", _WANTED)
    found = "; ".join(f"{r.name} {_value(facts, r)}, wanted {r} ({r.declared})" for r in wrong)
    if all(r.name in facts.fly_sets for r in wrong):
        return Finding.remedied_by_fly(found, _WANTED, facts)
    return Finding(False, found, _WANTED, _cure(facts, wrong))


def _cure(facts: PreflightFacts, wrong: Sequence[RequiredParameter]) -> str:
    """Return what to do: set parameters by this program or by hand, or change the configuration."""
    unreported = [r.name for r in wrong if r.name not in facts.answers.parameters]
    reported = [r for r in wrong if r.name in facts.answers.parameters]
    settable = [r.name for r in reported if r.corrected(facts.answers.parameters[r.name]) is not None]
    by_hand = [r.name for r in reported if r.name not in settable]
    declared = [r.declared for r in reported]
    by_policy: dict[str, list[str]] = {}
    for r in reported:
        if r.declared.startswith("preflight.policy."):
            by_policy.setdefault(r.declared.split(":")[0], []).append(r.name)
    keys = sorted({text.split(":")[0] for text in declared if text.split(":")[0].isidentifier()})
    texts = [
        _setting(facts, settable) if settable else "",
        f"set {_names(by_hand)} on the vehicle by hand" if by_hand else "",
        *(f"or, for {_names(by_policy[key])} only, declare another {key}" for key in sorted(by_policy)),
        "or correct `wings`" if any(text.startswith("wings.") for text in declared) else "",
        f"or correct {_names(keys)} of the vehicle" if keys else "",
        f"check the vehicle's link, or use a firmware with {_names(unreported)}" if unreported else "",
    ]
    return "; ".join(text for text in texts if text)


def _setting(facts: PreflightFacts, names: Sequence[str]) -> str:
    """Return the remedy for wrong parameters that `fly` can set."""
    if facts.fly_sets:
        return f"`fly` sets {_names(names)}"
    if facts.may_set_parameters:
        return f"set {_names(names)} on the vehicle: the values written by this program have no effect"
    return f"set {_names(names)} on the vehicle, or set preflight.set_parameters: true"


def _names(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _value(facts: PreflightFacts, required: RequiredParameter) -> str:
    value = facts.answers.parameters.get(required.name)
    return "not reported" if value is None else f"{value:g}"

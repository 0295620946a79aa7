"""The section `rules`: its errors, and the rules that are active."""

from __future__ import annotations

from pathlib import Path

import pytest
from config_files import GOOD, assert_problems, problems

from swarmctl.agent.failsafes import RULES
from swarmctl.config import model, scenario
from swarmctl.config.checks import check_config

ALWAYS = ["lost_link", "taken_over"]
CHOSEN = sorted(rule.NAME for rule in RULES)


def built(text: str, tmp_path: Path) -> scenario.Scenario:
    file = tmp_path / "swarm.yaml"
    file.write_text(GOOD + text)
    return scenario.build(model.load(file, check_config))


def names(swarm: scenario.Scenario) -> list[str]:
    return sorted(active.rule.NAME for active in swarm.tasks[0].rules)


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ("{gps_los: null}", [(":11: rules.gps_los", "'gps_loss'")]),
        ("{lost_link: null}", [(":11: rules.lost_link",)]),
        ("{taken_over: null}", [(":11: rules.taken_over",)]),
        ("{gps_loss: off}", [(":11: rules.gps_loss", "null")]),
        ("{gps_loss: {land_s: 0}}", [(":11: rules.gps_loss.land_s", "0")]),
        ("{gps_loss: {seconds: -1}}", [(":11: rules.gps_loss.seconds", "-1")]),
        ("{low_battery: {return_percent: 101}}", [(":11: rules.low_battery.return_percent", "101")]),
        (
            "{low_battery: {return_percent: 10, land_percent: 20}}",
            [(":11: rules.low_battery", "land_percent 20", "return_percent 10")],
        ),
        ("{not_following: {action: explode}}", [(":11: rules.not_following.action", "'explode'")]),
        ("{not_following: {metre: 5}}", [(":11: rules.not_following.metre", "'metres'")]),
        (
            "{fence_ahead: {seconds: 0}, not_following: {metres: -3}}",
            [(":11: rules.fence_ahead.seconds", "0"), (":11: rules.not_following.metres", "-3")],
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_error_in_a_rule_is_reported_at_its_key(
    rules: str, expected: list[tuple[str, ...]], tmp_path: Path
) -> None:
    assert_problems(problems(f"{GOOD}rules: {rules}\n", tmp_path), expected)


def test_all_rules_are_active_by_default(tmp_path: Path) -> None:
    assert names(built("", tmp_path)) == sorted([*ALWAYS, *CHOSEN])


@pytest.mark.parametrize("rule", CHOSEN)
def test_null_turns_one_rule_off_and_no_other(rule: str, tmp_path: Path) -> None:
    kept = [name for name in CHOSEN if name != rule]
    assert names(built(f"rules: {{{rule}: null}}\n", tmp_path)) == sorted([*ALWAYS, *kept])


def test_a_parameter_of_a_rule_reaches_every_vehicle_and_no_default_changes(
    tmp_path: Path,
) -> None:
    swarm = built("rules: {low_battery: {return_percent: 40}}\n", tmp_path)
    for task in swarm.tasks:
        (active,) = (r for r in task.rules if r.rule.NAME == "low_battery")
        assert (active.params.return_percent, active.params.land_percent) == (40.0, 10.0)


def test_the_rule_of_a_lost_link_follows_the_policy(tmp_path: Path) -> None:
    swarm = built("preflight: {policy: {lost_link: land, lost_link_after_s: 30}}\n", tmp_path)
    (active,) = (r for r in swarm.tasks[0].rules if r.rule.NAME == "lost_link")
    assert (active.params.does, active.params.after_s) == ("land", 30.0)

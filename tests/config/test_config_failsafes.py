"""The section `rules`: what is wrong with it, and which rules fly."""

from __future__ import annotations

from pathlib import Path

import pytest
from config_files import GOOD, problems

from swarmctl.config import model, scenario
from swarmctl.config.checks import check_config

ALWAYS = ["lost_link", "taken_over"]
CHOSEN = ["fence_ahead", "gps_loss", "low_battery", "not_following"]


def built(text: str, tmp_path: Path) -> scenario.Scenario:
    file = tmp_path / "swarm.yaml"
    file.write_text(GOOD + text)
    return scenario.build(model.load(file, check_config))


def names(swarm: scenario.Scenario) -> list[str]:
    return sorted(ruling.rule.NAME for ruling in swarm.tasks[0].rules)


@pytest.mark.parametrize(
    ("rules", "says"),
    [
        ("{gps_los: null}", [":11: rules.gps_los: unknown key; did you mean 'gps_loss'?"]),
        ("{lost_link: null}", [":11: rules.lost_link: unknown key"]),
        ("{taken_over: null}", [":11: rules.taken_over: unknown key"]),
        (
            "{gps_loss: off}",
            [":11: rules.gps_loss: expected a section: keys with their values; null turns the rule off"],
        ),
        ("{gps_loss: {land_s: 0}}", [":11: rules.gps_loss.land_s: input should be greater than 0"]),
        ("{gps_loss: {seconds: -1}}", [":11: rules.gps_loss.seconds: input should be greater than or equal"]),
        ("{low_battery: {return_percent: 101}}", [":11: rules.low_battery.return_percent: input should be"]),
        (
            "{low_battery: {return_percent: 10, land_percent: 20}}",
            [":11: rules.low_battery: land_percent 20 is above return_percent 10"],
        ),
        ("{not_following: {action: explode}}", [":11: rules.not_following.action: "]),
        (
            "{not_following: {metre: 5}}",
            [":11: rules.not_following.metre: unknown key; did you mean 'metres'"],
        ),
        (
            "{fence_ahead: {seconds: 0}, not_following: {metres: -3}}",
            [":11: rules.fence_ahead.seconds: ", ":11: rules.not_following.metres: "],
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_wrong_rule_is_said_where_it_stands(rules: str, says: list[str], tmp_path: Path) -> None:
    found = problems(f"{GOOD}rules: {rules}\n", tmp_path)
    assert [line[: len(text)] for line, text in zip(found, says, strict=True)] == says


def test_all_rules_fly_where_nothing_is_said(tmp_path: Path) -> None:
    assert names(built("", tmp_path)) == sorted([*ALWAYS, *CHOSEN])


@pytest.mark.parametrize("rule", CHOSEN)
def test_a_rule_that_is_null_does_not_fly_and_the_others_do(rule: str, tmp_path: Path) -> None:
    kept = [name for name in CHOSEN if name != rule]
    assert names(built(f"rules: {{{rule}: null}}\n", tmp_path)) == sorted([*ALWAYS, *kept])


def test_what_is_said_of_a_rule_reaches_every_vehicle_and_the_rest_stays(tmp_path: Path) -> None:
    swarm = built("rules: {low_battery: {return_percent: 40}}\n", tmp_path)
    for task in swarm.tasks:
        (ruling,) = (r for r in task.rules if r.rule.NAME == "low_battery")
        assert (ruling.params.return_percent, ruling.params.land_percent) == (40.0, 10.0)


def test_the_rule_of_a_lost_link_is_what_the_policy_declares(tmp_path: Path) -> None:
    swarm = built("preflight: {policy: {lost_link: land, lost_link_after_s: 30}}\n", tmp_path)
    (ruling,) = (r for r in swarm.tasks[0].rules if r.rule.NAME == "lost_link")
    assert (ruling.params.does, ruling.params.after_s) == ("land", 30.0)

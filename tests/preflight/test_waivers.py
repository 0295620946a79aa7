"""Waivers of an operator."""

from __future__ import annotations

import pytest

from swarmctl.preflight.checks import CHECKS
from swarmctl.preflight.waivers import Waiver, parse_waivers


def test_a_waiver_names_a_check_and_perhaps_a_vehicle() -> None:
    everyone, one = parse_waivers(["battery", "gps:uav2"], ["uav1", "uav2"])
    assert (everyone, one) == (Waiver("battery"), Waiver("gps", "uav2"))
    assert everyone.covers("battery", "uav1")
    assert one.covers("gps", "uav2")
    assert not one.covers("gps", "uav1")
    assert not one.covers("battery", "uav2")


@pytest.mark.parametrize("name", ["identity", "unique", "position"])
def test_identity_and_position_may_not_be_waived(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}.* gps, home,"):
        parse_waivers([name], ["uav1"])


@pytest.mark.parametrize(
    ("text", "listed"), [("batery", "'batery'.* identity, unique"), ("gps:uav9", "'uav9'.* uav1")]
)
def test_an_unknown_name_is_refused_with_the_known_ones(text: str, listed: str) -> None:
    with pytest.raises(ValueError, match=listed):
        parse_waivers([text], ["uav1"])


def test_names_of_checks_are_distinct() -> None:
    assert len({check.NAME for check in CHECKS}) == len(CHECKS)

"""What an operator may take upon himself."""

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
def test_who_and_where_a_vehicle_is_may_not_be_waived(name) -> None:
    with pytest.raises(ValueError, match=f"{name} may not be waived; gps, home,"):
        parse_waivers([name], ["uav1"])


@pytest.mark.parametrize(
    ("text", "said"),
    [("batery", "no check 'batery'; there is identity"), ("gps:uav9", "no vehicle 'uav9'; there is uav1")],
)
def test_what_is_not_there_is_said(text, said) -> None:
    with pytest.raises(ValueError, match=said):
        parse_waivers([text], ["uav1"])


def test_names_are_distinct() -> None:
    assert len({check.NAME for check in CHECKS}) == len(CHECKS)

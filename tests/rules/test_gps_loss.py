"""A vehicle without a GPS fix."""

from __future__ import annotations

from facts import Judged, at, facts

from swarmctl.rules import Kind, gps_loss

NO_FIX = at(0.0, 0.0, gps_ok=False)


def test_it_is_said_and_in_the_end_the_vehicle_lands() -> None:
    rule = Judged(gps_loss, seconds=2.0, land_s=20.0)
    kinds = []
    for second in range(22):
        demand = rule(float(second), facts(NO_FIX))
        kinds.append(None if demand is None else demand.kind)
    assert kinds == [None] * 2 + [Kind.WARN] * 18 + [Kind.LAND] * 2


def test_a_fix_that_comes_back_in_time_ends_it_and_later_stops_no_landing() -> None:
    rule = Judged(gps_loss, seconds=2.0, land_s=20.0)
    for second in range(15):
        rule(float(second), facts(NO_FIX))
    assert rule(15.0, facts(at(0.0, 0.0, gps_ok=True))) is None
    for second in range(16, 37):
        rule(float(second), facts(NO_FIX))
    demand = rule(37.0, facts(at(0.0, 0.0, gps_ok=True)))
    assert demand is not None
    assert demand.kind is Kind.LAND


def test_who_has_no_receiver_is_not_heard_or_stands_on_the_ground_loses_none() -> None:
    rule = Judged(gps_loss, seconds=0.0, land_s=1.0)
    for second in range(10):
        assert rule(float(second), facts(at(0.0, 0.0, gps_ok=None))) is None
        assert rule(float(second), facts(NO_FIX, lost=True)) is None
        assert rule(float(second), facts(NO_FIX, doing="ground")) is None

"""Last resort: a vehicle stops in time, although another one follows it."""

from __future__ import annotations

from agent_stories import MID_M, codes
from collision_stories import ApproachStory


def test_a_vehicle_stops_in_time_if_its_follower_can_stop_too() -> None:
    story, obstacle_m = ApproachStory(), 230.0
    for east_m in range(100, 190, 10):
        story.other(1, obstacle_m, MID_M[1], (0.0, 0.0, 0.0), phase="holding")
        story.other(3, east_m - 45.0, MID_M[1], (10.0, 0.0, 0.0))
        if "stops-in-time" in codes(story.at(east_m)):
            return
    raise AssertionError("the vehicle does not stop")

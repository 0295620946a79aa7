"""A new speed during a mission: sent only in mission mode, and repeated while unanswered."""

from __future__ import annotations

from functools import partial

import pytest
from bench import Bench, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import Script

from swarmctl.mavlink.procedures.basic import set_speed

CHANGE_SPEED = mavlink.MAV_CMD_DO_CHANGE_SPEED


def sent(bench: Bench) -> list:
    return [m for _, m in bench.sent if m.get_type() == "COMMAND_LONG" and m.command == CHANGE_SPEED]


def test_the_ground_speed_is_sent_once_and_a_refusal_is_reported():
    bench = Bench(Script(speeds=False)).flying(plan(north=8))
    assert bench.do("set_speed", partial(set_speed, speed_m_s=6.5)).failure == "DO_CHANGE_SPEED: UNSUPPORTED"
    (message,) = sent(bench)
    assert (message.param1, message.param2, message.param3) == (mavlink.SPEED_TYPE_GROUNDSPEED, 6.5, -1.0)


@pytest.mark.parametrize(("mode", "number"), [("LOITER", 5), ("GUIDED", 4), ("RTL", 6)])
def test_nothing_is_sent_to_a_vehicle_that_does_not_fly_its_mission(mode, number):
    bench = Bench().flying(plan(north=8))
    bench.copter.mode = number
    bench.run(3)
    assert mode in bench.do("set_speed", partial(set_speed, speed_m_s=6.5)).failure
    assert sent(bench) == []


def test_an_unanswered_speed_is_repeated_a_limited_number_of_times():
    bench = Bench().flying(plan(north=8))
    bench.block = lambda message: getattr(message, "command", None) == CHANGE_SPEED
    assert "no answer" in bench.do("set_speed", partial(set_speed, speed_m_s=6.5)).failure
    assert [m.confirmation for m in sent(bench)] == [0, 1, 2, 3, 4]

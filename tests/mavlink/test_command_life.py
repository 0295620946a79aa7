"""The life of a command: it is repeated over a bad link only while its decision is young."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
from flying_bench import BOTH, FlyingBench, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.launch import LAUNCH_LASTS_S

HEARTBEAT_EVERY_S = 4.5
"""interval of the heartbeats that arrive, so that each try of a command takes this long"""


def ready(personality: str) -> FlyingBench:
    return FlyingBench(personality).uploaded(plan(north=20))


def flying(personality: str) -> FlyingBench:
    return FlyingBench(personality).flying(plan(north=20))


@BOTH
@pytest.mark.parametrize(
    ("before", "name", "procedure", "number", "life_s"),
    [
        (ready, "launch", basic.launch, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, LAUNCH_LASTS_S),
        (
            flying,
            "set_speed",
            partial(basic.set_speed, speed_m_s=6.5),
            mavlink.MAV_CMD_DO_CHANGE_SPEED,
            basic.SPEED_LASTS_S,
        ),
    ],
)
def test_an_unanswered_command_is_not_sent_after_its_life(
    personality: str,
    before: Callable[[str], FlyingBench],
    name: str,
    procedure: Callable[..., object],
    number: int,
    life_s: float,
) -> None:
    bench = before(personality)
    bench.sent.clear()
    begin_s = bench.now
    bench.block = lambda message: getattr(message, "command", None) == number
    bench.block_down = lambda message: (
        message.get_type() == "HEARTBEAT"
        and (bench.now - begin_s) % HEARTBEAT_EVERY_S < HEARTBEAT_EVERY_S - 1.0
    )
    failure = bench.do(name, procedure).failure
    assert "[command-late]" in failure
    times_s = [at_s for at_s, message in bench.sent if getattr(message, "command", None) == number]
    assert len(times_s) > 1
    assert times_s[-1] - begin_s <= life_s

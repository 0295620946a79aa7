"""Parameters at extreme values in flight: the motion stays physical."""

import math
import struct

import numpy as np
import pytest
from fuzz_bench import CRAFT, Bench
from fuzz_values import DEAFENING
from pymavlink.dialects.v20 import ardupilotmega as mavlink

pytestmark = pytest.mark.full

FASTEST_M_S = 250.0  # a diving plane in the strongest wind
LARGEST = 3.4e38
REAL, INTEGER = mavlink.MAV_PARAM_TYPE_REAL32, mavlink.MAV_PARAM_TYPE_INT32


def set_parameter(bench: Bench, name: str, value: float) -> None:
    personality = bench.fleet.vehicles[0].personality
    kind, sent = REAL, value
    if personality.parameters.byte_wise and isinstance(personality.parameters.defaults[name], int):
        whole = round(min(max(value, -(2**31)), 2**31 - 1))
        kind, sent = INTEGER, struct.unpack("<f", struct.pack("<i", whole))[0]
        if math.isnan(sent):  # a float changes these bytes
            return
    for sysid in (1, 2):
        bench.send(mavlink.MAVLink_param_set_message(sysid, 1, name.encode(), sent, kind))


def is_sane(bench: Bench) -> bool:
    dynamics = bench.fleet.world.dynamics
    columns = (
        dynamics.position,
        dynamics.velocity,
        dynamics.attitude,
        dynamics.estimate,
        dynamics.airspeed_m_s,
    )
    moves_m_s = np.linalg.norm(dynamics.velocity, axis=0)
    return all(np.isfinite(column).all() for column in columns) and bool((moves_m_s < FASTEST_M_S).all())


@pytest.mark.parametrize("value", [LARGEST, -LARGEST, 0.0, 1e-45, -1.0, 32.0])
@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_each_parameter_at_an_extreme_value(name: str, kind: str, value: float) -> None:
    bench = Bench(name, kind)
    bench.fly()
    for parameter, usual in bench.fleet.vehicles[0].personality.parameters.defaults.items():
        if parameter in DEAFENING:
            continue
        set_parameter(bench, parameter, value)
        bench.wait(0.3)
        assert is_sane(bench), parameter
        set_parameter(bench, parameter, usual)
    bench.wait(2.0)
    bench.check()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_a_nan_value_is_refused(name: str, kind: str, value: float) -> None:
    bench = Bench(name, kind)
    personality = bench.fleet.vehicles[0].personality
    for parameter, usual in personality.parameters.defaults.items():
        if not (personality.parameters.byte_wise and isinstance(usual, int)):
            bench.send(mavlink.MAVLink_param_set_message(1, 1, parameter.encode(), value, REAL))
    reported = [m.param_value for _, m in bench.received if m.get_type() == "PARAM_VALUE"]
    assert reported
    assert all(map(math.isfinite, reported))

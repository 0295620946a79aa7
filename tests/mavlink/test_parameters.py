"""Parameters by name, over both encodings and bad wires."""

from __future__ import annotations

import re
import struct
from functools import partial

import pytest
from flying_bench import BOTH, FlyingBench, on_the_ground, plan
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.parameters import Parameter, encoded, read_parameters, set_parameters
from swarmctl.mavlink.protocol.wait import Requests

WHOLE = {"ardupilot": "FENCE_ENABLE", "px4": "NAV_DLL_ACT"}
REAL = {"ardupilot": "FENCE_ALT_MAX", "px4": "GF_MAX_VER_DIST"}
INT32 = int(mavlink.MAV_PARAM_TYPE_INT32)


def read(bench: FlyingBench, *names: str) -> dict[str, float]:
    procedure = partial(read_parameters, names=names)
    return {name: p.value for name, p in bench.do("read", procedure).items()}


def write(bench: FlyingBench, **wanted: float) -> str | None:
    procedure = partial(set_parameters, wanted=wanted)
    return bench.do("write", procedure).failure


@BOTH
@pytest.mark.autopilots("1.16")
@pytest.mark.autopilots("1.16", of="px4")
def test_known_names_are_read_and_an_unknown_one_is_missing(personality):
    bench = on_the_ground(personality, params={WHOLE[personality]: 1, REAL[personality]: 77.5})
    found = read(bench, WHOLE[personality], REAL[personality], "NO_SUCH_NAME")
    assert found == {WHOLE[personality]: 1.0, REAL[personality]: 77.5}


@BOTH
def test_more_names_than_a_vehicle_queues_are_read(personality):
    bench = on_the_ground(personality)
    names = [name for name, _ in list(bench.params.items())[:40]]
    found = read(bench, *names)
    assert found == pytest.approx({name: bench.params[name] for name in names}, rel=1e-6)


def test_a_vehicle_that_answers_slowly_gets_each_request_once():
    """It answers two requests a second, one after the other, so that the last of ten waits for 5 s."""
    requests = {n: mavlink.MAVLink_param_request_read_message(1, 1, b"", n) for n in range(26)}
    asked = Requests(requests, lambda m, _now: (m.param_index, m), tries=10, max_pending=10)
    waiting = asked.start(0.0)
    n_sent = len(waiting)
    for now in range(1, 14):
        new = asked.tick(now - 0.5) + asked.receive(waiting.pop(0), now - 0.5)
        new += asked.tick(float(now)) + asked.receive(waiting.pop(0), float(now))
        n_sent += len(new)
        waiting += new
    assert sorted(asked.result) == sorted(requests)
    assert n_sent == len(requests)


@BOTH
def test_a_parameter_that_differs_is_set_and_confirmed(personality):
    bench = on_the_ground(personality)
    assert write(bench, **{WHOLE[personality]: 1, REAL[personality]: 62.5}) is None
    assert bench.params[WHOLE[personality]] == 1
    assert bench.params[REAL[personality]] == 62.5


@BOTH
def test_a_parameter_with_the_wanted_value_is_not_sent(personality):
    bench = on_the_ground(personality, params={WHOLE[personality]: 1})
    assert write(bench, **{WHOLE[personality]: 1}) is None
    assert bench.of("PARAM_SET") == []


@BOTH
def test_no_parameter_is_set_if_one_name_is_unknown(personality):
    bench = on_the_ground(personality)
    before = bench.params[WHOLE[personality]]
    failure = write(bench, **{WHOLE[personality]: 1 - before, "NO_SUCH_NAME": 2})
    assert "NO_SUCH_NAME" in failure
    assert "[parameter-unknown]" in failure
    assert bench.params[WHOLE[personality]] == before


@BOTH
def test_an_armed_vehicle_gets_no_parameter_messages(personality):
    bench = FlyingBench(personality).flying(plan(north=8))
    before, sent = bench.params[WHOLE[personality]], len(bench.sent)
    assert "[armed]" in write(bench, **{WHOLE[personality]: 1 - before})
    bench.run(10.0)
    assert [m for _, m in bench.sent[sent:] if m.get_type().startswith("PARAM")] == []
    assert bench.params[WHOLE[personality]] == before


@BOTH
def test_no_parameter_is_set_on_a_vehicle_that_is_armed_meanwhile(personality):
    bench = FlyingBench(personality).uploaded(plan(north=8))
    before = bench.params[WHOLE[personality]]
    bench.block_down = lambda m: m.get_type() == "PARAM_VALUE"
    procedure = partial(set_parameters, wanted={WHOLE[personality]: 1 - before})
    bench.begin("write", procedure)
    bench.another_commands(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    assert bench.run(5.0, lambda: bench.session.state.armed)
    bench.block_down = lambda m: False
    assert bench.run(60.0, lambda: bench.session.busy_with is None)
    assert "[armed]" in bench.result.failure
    assert bench.of("PARAM_SET") == []
    assert bench.params[WHOLE[personality]] == before


def test_a_value_that_the_vehicle_does_not_keep_is_reported():
    bench = on_the_ground("ardupilot")
    failure = write(bench, FORMAT_VERSION=3)  # read-only there
    assert failure.startswith("FORMAT_VERSION ")
    assert re.findall(r"\d+", failure) == ["120", "3"]


def test_an_integer_parameter_of_px4_takes_no_fraction():
    bench = on_the_ground("px4")
    failure = write(bench, NAV_DLL_ACT=1.5)
    assert " 1.5 " in failure
    assert bench.of("PARAM_SET") == []


@settings(max_examples=examples(25), deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    loss=st.floats(0.0, 0.5), seed=st.integers(0, 10_000), personality=st.sampled_from(["ardupilot", "px4"])
)
def test_success_is_reported_truly_over_a_bad_link(loss, seed, personality):
    bench = on_the_ground(personality, loss=loss, seed=seed)
    failure = write(bench, **{WHOLE[personality]: 1, REAL[personality]: 40.0})
    kept = bench.params[WHOLE[personality]] == 1 and bench.params[REAL[personality]] == 40.0
    assert failure is not None or kept


@settings(deadline=None, derandomize=True)
@given(st.integers(-(2**31), 2**31 - 1))
def test_an_integer_keeps_its_four_bytes_or_is_refused(number):
    try:
        field = encoded(Parameter(float(number), INT32), byte_wise=True)
    except ValueError:
        # A signalling NaN: a float on the way would change it.
        exponent, fraction = number >> 23 & 0xFF, number & 0x7FFFFF
        assert exponent == 0xFF
        assert 0 < fraction < 0x400000
    else:
        assert struct.pack("<f", field) == struct.pack("<i", number)

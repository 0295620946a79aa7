"""After a storm of random messages of all types a vehicle still answers, unless one of them explains it."""

import random
from typing import Any

import pytest
from fuzz_bench import CRAFT, Bench
from fuzz_values import random_message
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet

KINDS = [kind for kind in mavlink.mavlink_map.values() if kind.msgname != "SETUP_SIGNING"]
SYSTEM_ID = {"ardupilot": b"SYSID_THISMAV", "px4": b"MAV_SYS_ID"}
KEY = bytes(range(32))
MESSAGES, BURST = 120, 20
ARDUPILOT = CRAFT[0]


def answers(bench: Bench, station: int = 0) -> bool:
    """Return True if vehicle 1 answers a parameter read; during a reboot it has 3 s."""
    read = mavlink.MAVLink_param_request_read_message(1, 1, SYSTEM_ID[bench.name], -1)
    replies = [*bench.send(read, station), *bench.wait(0.1)]
    if not any(m.get_type() == "PARAM_VALUE" for m in replies):
        bench.wait(3.0)
        replies = [*bench.send(read, station), *bench.wait(0.1)]
    return any(m.get_type() == "PARAM_VALUE" and m.get_srcSystem() == 1 for m in replies)


def storm(bench: Bench, seed: int, messages: int) -> None:
    source = random.Random(f"storm {seed}")
    for number in range(messages):
        bench.send(random_message(source.choice(KINDS), source), station=source.choice((0, 1)))
        if number % BURST == 0:
            bench.wait(0.1)


@pytest.mark.parametrize(("name", "kind"), CRAFT)
@settings(derandomize=True, deadline=None, max_examples=examples(30, least=3))
@given(seed=st.integers(0, 10**6))
def test_a_vehicle_answers_after_a_storm_without_a_signing_key(name: str, kind: str, seed: int) -> None:
    bench = Bench(name, kind)
    storm(bench, seed, MESSAGES)
    assert answers(bench)
    assert not bench.fleet.vehicles[0].signing.active


@pytest.mark.full
@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_a_vehicle_answers_after_a_long_storm(name: str, kind: str) -> None:
    bench = Bench(name, kind)
    storm(bench, 1, 4000)
    assert answers(bench)


# -- a random SETUP_SIGNING -------------------------------------------------------------------------------


def random_setup(target: int) -> Any:
    return mavlink.MAVLink_setup_signing_message(target, 255, list(KEY), 7)


@pytest.mark.parametrize(("target", "hears"), [(1, False), (0, False), (2, True), (9, True)])
def test_setup_signing_to_an_ardupilot_leaves_it_deaf_to_unsigned_messages(target: int, hears: bool) -> None:
    bench = Bench(*ARDUPILOT)
    bench.send(random_setup(target))
    assert answers(bench) is hears


def test_a_px4_ignores_setup_signing() -> None:
    bench = Bench("px4", "copter")
    bench.send(random_setup(1))
    assert answers(bench)


def test_an_armed_ardupilot_refuses_a_key_and_hears_on() -> None:
    bench = Bench(*ARDUPILOT)
    bench.fly()
    replies = bench.send(random_setup(1))
    assert [m.severity for m in replies if m.get_type() == "STATUSTEXT"] == [mavlink.MAV_SEVERITY_WARNING]
    assert answers(bench)


def test_only_the_key_ends_the_signing_and_a_reboot_does_not() -> None:
    bench = Bench(*ARDUPILOT)
    bench.sign(1)
    assert answers(bench)
    bench.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    bench.wait(3.0)
    assert answers(bench)
    bench.set_signatures(on=False)
    assert not answers(bench)
    bench.set_signatures(on=True)
    bench.send(mavlink.MAVLink_setup_signing_message(1, 1, [0] * 32, 0))
    bench.set_signatures(on=False)
    assert answers(bench)


def test_a_trusted_link_accepts_unsigned_messages_and_answers_with_signatures() -> None:
    """SERIAL0 of ArduCopter 4.6.2 answered unsigned and wrongly signed requests too."""
    bench = Bench(*ARDUPILOT)
    bench.fleet = Fleet(bench.fleet.scenario, ready_s=0.0, trusted_links=(0,))
    bench.send(random_setup(1))
    assert answers(bench)
    assert bench.raw[-1][2] & 1  # the bit of a signed frame

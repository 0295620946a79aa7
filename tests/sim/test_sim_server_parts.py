"""The parts of the server without sockets: datagrams, lateness, the manual clock, ports."""

import asyncio
import errno
import os
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.fleet import Fleet
from sim_vehicle.links import LinkError
from sim_vehicle.links.base import cannot_open
from sim_vehicle.links.url import parse_url
from sim_vehicle.serving.manual_clock import ManualClock
from sim_vehicle.serving.options import FleetOptions, make_scenario
from sim_vehicle.serving.pace import ManualPace
from sim_vehicle.serving.server import MAX_DATAGRAM_BYTES, Lateness, Server, joined

PROPERTY = settings(max_examples=examples(50))
FRAMES = st.lists(st.tuples(st.integers(0, 4), st.binary(min_size=1, max_size=300)), max_size=40)


@PROPERTY
@given(FRAMES)
def test_datagrams_have_whole_frames_of_one_vehicle_in_order(frames: list[tuple[int, bytes]]) -> None:
    datagrams = list(joined(frames))
    assert all(len(data) <= MAX_DATAGRAM_BYTES for _, data in datagrams)
    for vehicle in range(5):
        sent = b"".join(data for index, data in datagrams if index == vehicle)
        assert sent == b"".join(data for index, data in frames if index == vehicle)
    ends = {index: set[int]() for index in range(5)}
    position = dict.fromkeys(range(5), 0)
    for index, data in frames:
        position[index] += len(data)
        ends[index].add(position[index])
    position = dict.fromkeys(range(5), 0)
    for index, data in datagrams:
        position[index] += len(data)
        assert position[index] in ends[index]  # no frame is cut


def test_small_frames_of_a_vehicle_share_a_datagram() -> None:
    assert list(joined([(0, b"a"), (1, b"b"), (0, b"c")])) == [(0, b"ac"), (1, b"b")]


@PROPERTY
@given(st.lists(st.floats(0, 1.9), min_size=1, max_size=100), st.sampled_from([0.5, 0.9, 0.99, 1.0]))
def test_quantiles_are_exact_to_a_bin(late_s: Sequence[float], share: float) -> None:
    lateness = Lateness()
    for value in late_s:
        lateness.add(value)
    exact = sorted(late_s)[max(0, -int(-share * len(late_s) // 1) - 1)]
    assert exact - 1e-9 <= lateness.quantile_s(share) <= exact + 0.0005 + 1e-9
    assert lateness.count == len(late_s)


def run_manual_clock(lines: bytes, cuts: Sequence[int] = ()) -> tuple[list[float], list[str], list[str]]:
    """Return the ticks of 0.5 s that were run, the answers and the warnings."""

    async def stepped() -> None:
        pace = ManualPace()
        hand = ManualClock(pace, answers.append, warnings.append)
        for begin, end in zip([0, *cuts], [*cuts, len(lines)], strict=True):
            if begin < end:
                hand.feed(lines[begin:end])
        hand.feed(b"")
        tick = 0
        while not pace.finished:
            if await pace.due(tick * 0.5):
                ticks.append(tick * 0.5)
                tick += 1

    ticks: list[float] = []
    answers: list[str] = []
    warnings: list[str] = []
    asyncio.run(stepped())
    return ticks, answers, warnings


def test_manual_time_passes_as_granted() -> None:
    ticks, answers, warnings = run_manual_clock(b"step 1\nstep 0.2\nstep 0.3\nquit\nstep 9\n")
    assert ticks == [0, 0.5, 1.0, 1.5]
    assert answers == ["at 1", "at 1.2", "at 1.5"]
    assert warnings == []


def test_without_a_step_only_the_first_tick_runs() -> None:
    assert run_manual_clock(b"") == ([0], [], [])


def test_bad_lines_cause_a_warning_each() -> None:
    _, answers, warnings = run_manual_clock(b"step\nstep -1\nstep nan\nSTEP 1\n\xff\n\n")
    assert answers == []
    assert len(warnings) == 5
    assert all("`step SECONDS`" in text for text in warnings)


@PROPERTY
@given(st.lists(st.integers(0, 30), max_size=4).map(sorted))
def test_input_may_arrive_in_any_portions(cuts: list[int]) -> None:
    lines = b"step 1\nstep 0.25\nfly\nstep 0.25"
    ticks, answers, warnings = run_manual_clock(lines, [min(cut, 30) for cut in cuts])
    assert (ticks, answers) == ([0, 0.5, 1.0, 1.5], ["at 1", "at 1.25", "at 1.5"])
    assert len(warnings) == 1
    assert "'fly'" in warnings[0]


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (errno.EADDRINUSE, "[port-in-use]"),
        (errno.EADDRNOTAVAIL, "[no-such-address]"),
        (errno.EACCES, "[not-permitted]"),
        (errno.EMFILE, "[too-many-files]"),
        (errno.ENETUNREACH, ""),
    ],
)
def test_an_error_of_a_port_has_its_cause(number: int, code: str) -> None:
    text = str(cannot_open(parse_url("udpout:127.0.0.1:14550"), OSError(number, os.strerror(number))))
    assert text.startswith(f"cannot open udpout 127.0.0.1:14550: {os.strerror(number)}")
    assert code in text


def serve_three(port_step: int, *urls: str) -> Server:
    fleet = Fleet(make_scenario(FleetOptions(count=3, per_port=1))[0], ready_s=0)
    parsed = [parse_url(url) for url in urls]
    return Server(fleet, parsed, ManualPace(), warn=lambda text: None, port_step=port_step)


@pytest.mark.parametrize(
    ("port_step", "one", "other", "port"),
    [
        (1, "udpin:127.0.0.1:5000", "udpin:127.0.0.1:5001", 5001),
        (1, "udpin:127.0.0.1:5002", "udpin:0.0.0.0:5000", 5002),
        (10, "tcpin::5000", "tcpin:127.0.0.1:5020", 5020),
        (1, "udpout:127.0.0.1:5000", "udpout:127.0.0.1:5001", 5001),
    ],
)
def test_urls_with_overlapping_ports_are_refused(port_step: int, one: str, other: str, port: int) -> None:
    with pytest.raises(LinkError, match=rf"\b{port}\b.*\[port-overlap\]"):
        serve_three(port_step, one, other)


@pytest.mark.parametrize(
    ("port_step", "one", "other"),
    [
        (1, "udpin:127.0.0.1:5000", "udpin:127.0.0.1:5003"),
        (1, "udpin::5000", "tcpin::5001"),
        (10, "tcpin::5000", "tcpin::5001"),
        (1, "udpout:10.0.0.1:5000", "udpout:10.0.0.2:5001"),
    ],
)
def test_urls_with_separate_ports_are_accepted(port_step: int, one: str, other: str) -> None:
    assert serve_three(port_step, one, other).describe_ports()

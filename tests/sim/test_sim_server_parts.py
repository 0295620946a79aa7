"""The parts of the server that need no socket: datagrams, lateness, time by hand, the table."""

import asyncio
import errno
import io
import os
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from rich.console import Console

from sim_vehicle.fleet import Fleet
from sim_vehicle.links import LinkError
from sim_vehicle.links.base import cannot_open
from sim_vehicle.links.url import parse_url
from sim_vehicle.serving.display import Display
from sim_vehicle.serving.lateness import Lateness
from sim_vehicle.serving.manual_clock import Hand
from sim_vehicle.serving.options import FleetOptions, make_scenario
from sim_vehicle.serving.pace import ByHand
from sim_vehicle.serving.server import DATAGRAM_BYTES, Server, joined

PROPERTY = settings(derandomize=True, deadline=None, max_examples=examples(50))
FRAMES = st.lists(st.tuples(st.integers(0, 4), st.binary(min_size=1, max_size=300)), max_size=40)


@PROPERTY
@given(FRAMES)
def test_datagrams_hold_whole_frames_of_one_vehicle_in_order_and_fit(frames: list[tuple[int, bytes]]) -> None:
    datagrams = list(joined(frames))
    assert all(len(data) <= DATAGRAM_BYTES for _, data in datagrams)
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
def test_quantiles_are_right_to_a_bin(late_s: Sequence[float], share: float) -> None:
    lateness = Lateness()
    for value in late_s:
        lateness.add(value)
    exact = sorted(late_s)[max(0, -int(-share * len(late_s) // 1) - 1)]
    assert exact - 1e-9 <= lateness.quantile_s(share) <= exact + 0.0005 + 1e-9
    assert lateness.count == len(late_s)


def test_nothing_was_late_yet() -> None:
    assert str(Lateness().quantile_s(0.99)) == "nan"


def by_hand(lines: bytes, cuts: Sequence[int] = ()) -> tuple[list[float], list[str], list[str]]:
    """Ticks of half a second that were run, what was said and what was warned of."""

    async def stepped() -> None:
        pace = ByHand()
        hand = Hand(pace, said.append, warned.append)
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
    said: list[str] = []
    warned: list[str] = []
    asyncio.run(stepped())
    return ticks, said, warned


def test_time_by_hand_passes_as_granted() -> None:
    ticks, said, warned = by_hand(b"step 1\nstep 0.2\nstep 0.3\nquit\nstep 9\n")
    assert ticks == [0, 0.5, 1.0, 1.5]
    assert said == ["at 1", "at 1.2", "at 1.5"]
    assert warned == []


def test_without_a_step_only_the_beginning_happens() -> None:
    assert by_hand(b"") == ([0], [], [])


def test_lines_that_mean_nothing_are_named() -> None:
    _, said, warned = by_hand(b"step\nstep -1\nstep nan\nSTEP 1\n\xff\n\n")
    assert said == []
    assert len(warned) == 5
    assert all("expected `step SECONDS` and `quit`" in text for text in warned)


@PROPERTY
@given(st.lists(st.integers(0, 30), max_size=4).map(sorted))
def test_lines_may_be_cut_anywhere(cuts: list[int]) -> None:
    assert by_hand(b"step 1\nstep 0.25\nfly\nstep 0.25", [min(cut, 30) for cut in cuts]) == (
        [0, 0.5, 1.0, 1.5],
        ["at 1", "at 1.25", "at 1.5"],
        ["'fly' is not understood; expected `step SECONDS` and `quit`, for example step 0.5"],
    )


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EADDRINUSE, "Is another program using it? Choose another port"),
        (errno.EADDRNOTAVAIL, "This machine has no such address"),
        (errno.EACCES, "You may not use it"),
        (errno.EMFILE, "Allow more open files (ulimit -n)"),
        (errno.ENETUNREACH, "Check the network"),
    ],
)
def test_a_port_that_cannot_be_had_is_blamed_on_what_it_was(number: int, words: str) -> None:
    said = str(cannot_open(parse_url("udpout:127.0.0.1:14550"), OSError(number, os.strerror(number))))
    assert said.startswith(f"cannot open udpout 127.0.0.1:14550: {os.strerror(number)}. {words}")


def serve_three(port_step: int, *urls: str) -> Server:
    fleet = Fleet(make_scenario(FleetOptions(count=3, per_port=1))[0], ready_s=0)
    parsed = [parse_url(url) for url in urls]
    return Server(fleet, parsed, ByHand(), warn=lambda text: None, port_step=port_step)


@pytest.mark.parametrize(
    ("port_step", "one", "other", "port"),
    [
        (1, "udpin:127.0.0.1:5000", "udpin:127.0.0.1:5001", 5001),
        (1, "udpin:127.0.0.1:5002", "udpin:0.0.0.0:5000", 5002),
        (10, "tcpin::5000", "tcpin:127.0.0.1:5020", 5020),
        (1, "udpout:127.0.0.1:5000", "udpout:127.0.0.1:5001", 5001),
    ],
)
def test_urls_whose_ports_meet_are_refused(port_step: int, one: str, other: str, port: int) -> None:
    with pytest.raises(LinkError, match=rf"with 3 ports each, both would have port {port}; begin further"):
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
def test_urls_whose_ports_do_not_meet_are_taken(port_step: int, one: str, other: str) -> None:
    assert serve_three(port_step, one, other).ports_words()


def picture(options: FleetOptions, width: int, height: int, wall_s: float = 0.0) -> list[str]:
    fleet = Fleet(make_scenario(options)[0], ready_s=0)
    fleet.step(0.0)
    server = Server(fleet, [parse_url("udpout:127.0.0.1:14550")], ByHand(), warn=lambda text: None)
    console = Console(file=io.StringIO(), width=width, height=height, color_system=None)
    display = Display(server)
    display.render(0.0, width, height)
    console.print(display.render(wall_s, width, height))
    assert isinstance(console.file, io.StringIO)
    return [text.rstrip() for text in console.file.getvalue().splitlines()]


def test_the_table_fits_the_terminal_whatever_its_size() -> None:
    for width, height, count in ((80, 24, 5), (120, 40, 40), (60, 10, 260)):
        lines = picture(FleetOptions(count=count, personality="mixed"), width, height)
        assert len(lines) <= height - 1
        assert all(len(text) <= width for text in lines)


def test_every_vehicle_is_on_some_page() -> None:
    seen = set()
    for page in range(4):
        lines = picture(FleetOptions(count=40), 80, 16, wall_s=page * 5.0)
        assert f"page {page + 1}/4  40 vehicles" in lines[-1]
        seen |= {int(text.split()[0]) for text in lines if text.split()[0].isdecimal()}
    assert seen == set(range(1, 41))


def test_a_wide_terminal_has_room_for_the_place() -> None:
    wide = "\n".join(picture(FleetOptions(), 120, 30))
    narrow = "\n".join(picture(FleetOptions(), 80, 30))
    assert "46.049000, 14.506000" in wide
    assert "46.049000" not in narrow
    assert "ardupilot copter" in narrow

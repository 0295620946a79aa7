"""The ground station's view: what is taken of what comes, and how it is shown."""

from __future__ import annotations

import asyncio
from io import StringIO
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from swarmctl.bus import keys
from swarmctl.bus.memory import MemoryBus
from swarmctl.clock import run_virtual
from swarmctl.core.frames import Frame, Seal, StateShared
from swarmctl.core.grid import Grid
from swarmctl.core.observation import Observation
from swarmctl.watch import ONCE_S, Board, Lines, View, line, table, watch

pytestmark = pytest.mark.virtual

GRID = Grid(8, 8, 50.0, 46.0, 14.4)
NAMES = {1: "uav1", 2: "uav2", 3: "scout"}
SEAL = Seal("test")


def state(cell: tuple[int, int] = (4, 3), **changes: Any) -> StateShared:
    lat_deg, lon_deg = GRID.centre(cell)
    known = {"time_s": 20.0, "lat_deg": lat_deg, "lon_deg": lon_deg, "alt_rel_m": 40.0, "phase": "flying"}
    return StateShared(**{**known, "n_observed": 31, "n_found": 3, "mode": "AUTO", "plan_id": 5, **changes})


def frame(content: Any, sender: int = 1, n: int = 1, incarnation: int = 1) -> bytes:
    return SEAL.close(Frame(sender, incarnation, n, 0.0, content))


def board() -> Board:
    return Board("test", NAMES, GRID, Seal("test"))


def key(uav: int) -> str:
    return keys.to_station("test", uav)


def text(view: View) -> str:
    shown = Console(width=130, record=True, file=StringIO())
    shown.print(table(view))
    return shown.export_text()


def test_what_vehicles_tell_is_shown_in_rows() -> None:
    seen = board()
    seen.take(key(1), frame(state()), 100.0)
    late = state(
        (0, 0),
        phase="holding",
        mode="GUIDED",
        late_s=151.4,
        outcome="hold ordered",
        refused=2,
        flagged=(1, 9),
    )
    seen.take(key(3), frame(late, sender=3), 93.0)
    shown = text(seen.view("tcp/127.0.0.1:7447: reached", 100.4))
    lines = [" ".join(row.split()) for row in shown.splitlines()]
    assert "test tcp/127.0.0.1:7447: reached" in lines
    assert "uav1 flying AUTO 4,3 40 0 31 3 5 0" in lines
    assert "uav2 – – – – never – – – – –" in lines
    assert "scout holding GUIDED 0,0 40 7 31 3 5 151 2 uav1, 9" in lines
    assert "scout: hold ordered" in lines


def test_a_vehicle_beside_the_area_is_said_to_be_outside() -> None:
    seen = board()
    seen.take(key(1), frame(state(lat_deg=45.0)), 0.0)
    (row, *_) = seen.view("", 0.0).rows
    assert row.cell is None
    assert "outside the area" in line(row)


def test_the_newest_counts_whatever_comes_last() -> None:
    seen = board()
    for n, incarnation, mode in ((5, 1, "A"), (4, 1, "late"), (1, 2, "B"), (9, 1, "of before its restart")):
        seen.take(key(1), frame(state(mode=mode), n=n, incarnation=incarnation), float(n))
    (row, *_) = seen.view("", 1.0).rows
    assert row.state is not None
    assert row.state.mode == "B"


REFUSED = [
    ("another's key", key(2), frame(state(), sender=1)),
    ("a wildcard", "swarmctl/test/station/inform/state/*", frame(state())),
    ("a key with more behind", key(1) + "/1", frame(state())),
    ("a stranger", key(9), frame(state(), sender=9)),
    ("what is no state", key(1), frame(Observation(1, 1, 0.0, ((1, 1, True),), 1))),
    ("no frame", key(1), b"nonsense"),
    ("nothing", key(1), b""),
]


@pytest.mark.parametrize(("under", "payload"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED])
def test_what_is_no_vehicles_own_state_is_refused_and_counted(under: str, payload: bytes) -> None:
    seen = board()
    seen.take(under, payload, 0.0)
    assert seen.refused == 1
    assert not seen.any_heard
    assert "refused here: 1 messages" in text(seen.view("", 0.0))


def test_who_does_not_sign_is_not_shown_where_keys_are_used() -> None:
    seen = Board("test", NAMES, GRID, Seal("test", None, lambda _uav, _signature, _data: False))
    seen.take(key(1), frame(state()), 0.0)
    assert (seen.refused, seen.any_heard) == (1, False)


@given(st.binary(max_size=60))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_no_bytes_break_it(data: bytes) -> None:
    board().take(key(1), b"\x02\x00" + data, 0.0)


def test_what_another_machine_says_cannot_steer_a_terminal() -> None:
    seen = board()
    seen.take(key(1), frame(state(phase="\x1b[2Jx", mode="[red]\n", trouble="\x1b[1m\r\n")), 0.0)
    view = seen.view("", 0.0)
    assert line(view.rows[0]).isprintable()
    assert "\x1b" not in text(view)
    assert "[red]?" in text(view)


def test_plain_lines_say_what_changed_and_everything_now_and_then() -> None:
    said: list[str] = []
    lines, seen = Lines(said.append, 5.0), board()
    for n in range(10):  # a view each half second: 5 s
        if n == 3:
            seen.take(key(1), frame(state(phase="standby")), n * 0.5)
        if n == 6:
            seen.take(key(1), frame(state(), n=2), n * 0.5)
        lines.show(seen.view("reached" if n > 1 else "not reached", n * 0.5))
    assert [text.split(",")[0] for text in said] == [
        "test: not reached", "uav1: not heard", "uav2: not heard", "scout: not heard",
        "test: reached",
        "uav1: standby AUTO", "uav1: flying AUTO",
    ]  # fmt: skip


def test_one_look_waits_for_all_but_not_for_ever() -> None:
    async def scene(speaking: tuple[int, ...]) -> tuple[list[View], float]:
        bus, seen = MemoryBus(), board()
        views: list[View] = []
        loop = asyncio.get_running_loop()
        for uav in speaking:
            loop.call_later(1.0, bus.put, key(uav), frame(state(), sender=uav))
        began_s = loop.time()
        await watch(bus, seen, "test", lambda: "reached", views.append, once=True)
        return views, loop.time() - began_s

    (view,), took_s = run_virtual(scene((1, 2, 3)))
    assert all(row.age_s is not None for row in view.rows)
    assert took_s < 2.0
    (view,), took_s = run_virtual(scene((1,)))
    assert [row.age_s is None for row in view.rows] == [False, True, True]
    assert took_s == pytest.approx(ONCE_S, abs=0.6)

"""The ground station's view: accepted and refused states, and their display."""

from __future__ import annotations

import asyncio
from io import StringIO
from typing import Any

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from profiles import examples
from rich.console import Console

from swarmctl.bus import keys
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.core.frames import UNSIGNED, VERSION, Frame, FrameCodec, StateShared
from swarmctl.core.grid import Grid
from swarmctl.core.observation import Observation
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.station.watch import ONCE_TIMEOUT_S, StateBoard, StateLines, StationView, line, table, watch

pytestmark = pytest.mark.virtual

GRID = Grid(8, 8, 50.0, 46.0, 14.4)
NAMES = {1: "uav1", 2: "uav2", 3: "scout"}
SEAL = FrameCodec("test")
UNIX_S = 1_800_000_000.0


def state(cell: tuple[int, int] = (4, 3), **changes: Any) -> StateShared:
    lat_deg, lon_deg = GRID.centre(cell)
    known = {"time_s": 20.0, "lat_deg": lat_deg, "lon_deg": lon_deg, "alt_rel_m": 40.0}
    known |= {"alt_amsl_m": 340.0, "phase": "flying"}
    return StateShared(**{**known, "n_observed": 31, "n_found": 3, "mode": "AUTO", "plan_id": 5, **changes})


def frame(content: Any, sender: int = 1, n: int = 1, incarnation: int = 1, unix_s: float = UNIX_S) -> bytes:
    return SEAL.encode(Frame(sender, incarnation, n, unix_s, content))


def board() -> StateBoard:
    return StateBoard("test", NAMES, GRID, FrameCodec("test"))


def key(uav: int) -> str:
    return keys.to_station("test", uav)


def text(view: StationView) -> str:
    shown = Console(width=130, record=True, file=StringIO())
    shown.print(table(view))
    return shown.export_text()


def test_states_are_shown_in_rows() -> None:
    seen = board()
    seen.receive(key(1), frame(state()), 100.0, UNIX_S)
    late = state(
        (0, 0),
        phase="holding",
        mode="GUIDED",
        late_s=151.4,
        outcome="hold ordered",
        refused=2,
        flagged=(1, 9),
    )
    seen.receive(key(3), frame(late, sender=3), 93.0, UNIX_S)
    shown = text(seen.view("tcp/127.0.0.1:7447", 100.4))
    lines = [" ".join(row.split()) for row in shown.splitlines()]
    assert "test tcp/127.0.0.1:7447" in lines
    assert "uav1 flying AUTO 4,3 40 0 31 3 5 0" in lines
    assert "uav2 – – – – never – – – –" in lines
    assert "scout holding GUIDED 0,0 40 7 31 3 5 2 151 uav1, 9" in lines
    assert "scout: hold ordered" in lines


def test_the_table_explains_its_columns_and_omits_empty_ones() -> None:
    seen = board()
    seen.receive(key(1), frame(state()), 100.0, UNIX_S)
    plain = text(seen.view("", 100.0))
    seen.receive(key(1), frame(state(late_s=151.4, flagged=(3,)), n=2), 100.0, UNIX_S)
    full = text(seen.view("", 100.0))
    for heading in ("phase", "mode", "cell", "height", "known", "plan", "refused"):
        assert f"{heading}: " in plain
    for heading in ("late", "contradicted by"):
        assert heading not in plain
        assert f"{heading}: " in full


def test_a_line_has_the_age_and_the_mode() -> None:
    seen = board()
    seen.receive(key(1), frame(state(phase="done")), 0.0, UNIX_S)
    (row, *_) = seen.view("", 7.0).rows
    assert line(row).startswith("uav1: done, ")
    assert all(f" {value}, " in line(row) for value in ("7 s old", "AUTO", "4,3"))


def test_a_vehicle_outside_the_area_has_no_cell() -> None:
    seen = board()
    seen.receive(key(1), frame(state(lat_deg=45.0)), 0.0, UNIX_S)
    (row, *_) = seen.view("", 0.0).rows
    assert row.cell is None
    assert " cell " not in line(row)


def test_the_newest_state_counts_in_any_order() -> None:
    seen = board()
    for n, incarnation, mode in ((5, 1, "A"), (4, 1, "late"), (1, 2, "B"), (9, 1, "of before its restart")):
        seen.receive(key(1), frame(state(mode=mode), n=n, incarnation=incarnation), float(n), UNIX_S)
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
def test_an_invalid_state_is_refused_and_counted(under: str, payload: bytes) -> None:
    seen = board()
    seen.receive(under, payload, 0.0, UNIX_S)
    assert seen.refused == 1
    assert not seen.has_any
    assert "\n1 messages " in text(seen.view("", 0.0))


def test_unsigned_states_are_refused_with_keys() -> None:
    seen = StateBoard("test", NAMES, GRID, FrameCodec("test", None, lambda _uav, _signature, _data: False))
    seen.receive(key(1), frame(state()), 0.0, UNIX_S)
    assert (seen.refused, seen.has_any) == (1, False)


@given(st.binary(max_size=60))
@settings(max_examples=examples(100), deadline=None, derandomize=True)
def test_any_bytes_are_handled(data: bytes) -> None:
    board().receive(key(1), b"\x02\x00" + data, 0.0, UNIX_S)


def test_a_replayed_state_is_refused() -> None:
    seen = board()
    first, second = frame(state()), frame(state(mode="HOLD"), n=2)
    for data in (second, second, first, second):
        seen.receive(key(1), data, 0.0, UNIX_S)
    assert seen.refused == 3
    seen = board()
    for unix_s in (UNIX_S - 86_400.0, UNIX_S - 61.0, UNIX_S + 61.0, 1e300, -1e300):
        seen.receive(key(1), frame(state(), n=3, unix_s=unix_s), 0.0, UNIX_S)
    assert (seen.refused, seen.has_any) == (5, False)
    seen.receive(key(1), frame(state(), n=3, unix_s=UNIX_S - 59.0), 0.0, UNIX_S)
    assert (seen.refused, seen.has_any) == (5, True)


FLOATS = st.one_of(
    st.sampled_from([float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 5e-324, -0.0, 90.0, -180.0]),
    st.floats(),
)
WHOLE = st.one_of(
    st.sampled_from([0, 1, -1, 2**63 - 1, -(2**63), 2**64 - 1]), st.integers(-(2**63), 2**64 - 1)
)
TEXTS = st.text(max_size=40)
STATES = st.fixed_dictionaries(
    {"type": st.just("inform/state"), "phase": TEXTS, "n_observed": WHOLE, "n_found": WHOLE}
    | dict.fromkeys(("time_s", "lat_deg", "lon_deg", "alt_rel_m"), FLOATS),
    optional=dict.fromkeys(("last_seq", "knows", "plan_id", "replans", "refused"), WHOLE)
    | dict.fromkeys(("mode", "outcome", "trouble"), TEXTS)
    | {"late_s": FLOATS, "flagged": st.lists(WHOLE, max_size=40)},
)
SANE = {"type": "inform/state", "time_s": 1.0, "lat_deg": 46.0, "lon_deg": 14.4, "alt_rel_m": 4.0}
SANE |= {"phase": "flying", "n_observed": 1, "n_found": 1}
STRANGE = st.one_of(
    STATES, STATES.map(lambda known: known | {"lat_deg": 46.0, "lon_deg": 14.4, "time_s": 1.0})
)
STRANGE = st.one_of(
    STRANGE,
    st.tuples(st.sampled_from(["alt_rel_m", "late_s", "time_s"]), FLOATS).map(lambda one: SANE | dict([one])),
    st.tuples(st.sampled_from(["n_observed", "n_found", "plan_id", "refused"]), WHOLE).map(
        lambda one: SANE | dict([one])
    ),
)


def written(content: dict[str, Any], unix_s: float, incarnation: int, n: int) -> bytes:
    """Return an encoded frame with a valid form and arbitrary values."""
    frame = {"sender": 1, "incarnation": incarnation, "n": n, "unix_s": unix_s, "content": content}
    return bytes((VERSION, UNSIGNED)) + msgspec.msgpack.encode(frame)


SEEN = st.tuples(
    STRANGE, st.one_of(st.just(UNIX_S), FLOATS), st.integers(1, 3), st.one_of(st.integers(1, 9), WHOLE)
)


@given(st.lists(SEEN, max_size=5))
@example([(SANE | {"alt_rel_m": 1e308}, UNIX_S, 1, 1)])
@example([(SANE | {"alt_rel_m": float("nan")}, UNIX_S, 1, 1)])
@example([(SANE | {"late_s": float("inf"), "plan_id": 2**63 - 1}, UNIX_S, 1, 1)])
@settings(max_examples=examples(300), deadline=None, derandomize=True)
def test_extreme_states_do_not_widen_the_table(
    states: list[tuple[dict[str, Any], float, int, int]],
) -> None:
    seen = board()
    for content, unix_s, incarnation, n in states:
        seen.receive(key(1), written(content, unix_s, incarnation, n), 0.0, UNIX_S)
        view = seen.view("", 0.0)
        text(view)
        said = line(view.rows[0])
        assert said.isprintable()
        assert len(said) < 350


@pytest.mark.parametrize("value", [1e7, -9e6, 1.1e6])
def test_an_impossible_height_is_shown_as_unknown(value: float) -> None:
    seen = board()
    seen.receive(key(1), frame(state(alt_rel_m=value)), 0.0, UNIX_S)
    (row, *_) = seen.view("", 0.0).rows
    assert "? m " in line(row)


def test_texts_of_other_machines_have_no_control_characters() -> None:
    seen = board()
    seen.receive(key(1), frame(state(phase="\x1b[2Jx", mode="[red]\n", trouble="\x1b[1m\r\n")), 0.0, UNIX_S)
    view = seen.view("", 0.0)
    assert line(view.rows[0]).isprintable()
    assert "\x1b" not in text(view)
    assert "[red]?" in text(view)


def test_plain_lines_show_changes_and_all_vehicles_in_intervals() -> None:
    said: list[str] = []
    lines, seen = StateLines(said.append, 5.0), board()
    for n in range(10):  # a view each half second: 5 s
        if n == 3:
            seen.receive(key(1), frame(state(phase="standby")), n * 0.5, UNIX_S)
        if n == 6:
            seen.receive(key(1), frame(state(), n=2), n * 0.5, UNIX_S)
        lines.show(seen.view("up" if n > 1 else "down", n * 0.5))
    shown = [text.split(",")[0].split(": ") for text in said]
    assert [name for name, _ in shown] == ["test", "uav1", "uav2", "scout", "test", "uav1", "uav1"]
    received = {n: shown[n][1] for n in (0, 4, 5, 6)}
    assert received == {0: "down", 4: "up", 5: "standby", 6: "flying"}


def test_a_single_view_waits_for_all_vehicles_with_a_time_out() -> None:
    async def scene(speaking: tuple[int, ...]) -> tuple[list[StationView], float]:
        bus, seen = MemoryBus(), board()
        views: list[StationView] = []
        loop = asyncio.get_running_loop()
        for uav in speaking:
            loop.call_later(1.0, bus.put, key(uav), frame(state(), sender=uav))
        began_s = loop.time()
        await watch(bus, seen, "test", lambda: "reached", views.append, once=True, wall_clock=lambda: UNIX_S)
        return views, loop.time() - began_s

    (view,), took_s = run_virtual(scene((1, 2, 3)))
    assert all(row.age_s is not None for row in view.rows)
    assert took_s < 2.0
    (view,), took_s = run_virtual(scene((1,)))
    assert [row.age_s is None for row in view.rows] == [False, True, True]
    assert took_s == pytest.approx(ONCE_TIMEOUT_S, abs=0.6)


def test_copies_of_messages_to_vehicles_are_checked_like_states() -> None:
    seen, codec_key = board(), keys.copy_to_station("test", "inform/observation", 1)
    observation = Observation(1, 1, 5.0, ((4, 4, True),), 1)
    accepted = seen.receive(codec_key, frame(observation, n=4), 100.0, UNIX_S)
    assert accepted is not None
    assert accepted.content == observation
    refused = [
        (codec_key, frame(observation, n=4), UNIX_S),  # again
        (codec_key, frame(observation, n=5), UNIX_S + 3600.0),  # an hour old
        (keys.copy_to_station("test", "inform/intent", 1), frame(observation, n=6), UNIX_S),
        (keys.copy_to_station("test", "inform/observation", 2), frame(observation, n=7), UNIX_S),
        (keys.to_station("test", 1), frame(observation, n=8), UNIX_S),
        (codec_key, frame(state(), n=9), UNIX_S),
    ]
    for wrong_key, payload, unix_s in refused:
        assert seen.receive(wrong_key, payload, 101.0, unix_s) is None
    assert seen.refused == len(refused)
    assert not seen.has_any

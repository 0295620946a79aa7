"""A ground station that died in flight, and the station that goes on with its run."""

from __future__ import annotations

import errno
import fcntl
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import pytest
from crash_world import Crash, Meanwhile, Moment, crashed, drift, lost_observations, resume, unfinished
from flights import AREA, coded, small, winged
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorded import effects, events
from trouble import MODES, Trouble, another_station_sends, interrupts, mode_message
from trouble import select_mode as select

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.fleet import Fleet
from swarmctl.config.scenario import Scenario
from swarmctl.core.records import replace
from swarmctl.flight import app
from swarmctl.flight.run import DEFAULT_OPTIONS
from swarmctl.flight.wiring import Flight
from swarmctl.links.base import SystemIdConflict
from swarmctl.mavlink import events as mavlink_events
from swarmctl.report import record, record_file, unfinished_run
from swarmctl.report.evidence.chain import Continued, check
from swarmctl.report.outcome import Ending
from swarmctl.report.unfinished_run import UnfinishedRunError

SMALLER = {**AREA, "rows": 6, "cols": 6}
OUTAGES_S = (0.5, 3.0, 5.0, 12.0, 30.0)
LOSSY = [{"fault": "packet_loss", "params": {"rate": 0.15}, "at_s": 5.0}]


def pair(autopilot: str = "ardupilot", **sections: object) -> Scenario:
    """Return two vehicles over 6 × 6 cells with 4 hostiles."""
    if autopilot == "arduplane":
        return winged(**sections)
    simulate = {"count": 2, "ready_s": 3.0, "autopilot": autopilot}
    return small(area=SMALLER, threats={"count": 4}, simulate=simulate, **sections)


def at(seconds: float) -> Moment:
    return lambda now, _sent: now >= seconds


def drawn_moment(drawn: random.Random) -> Moment:
    """Return a moment by time, by the messages before the launch, or amid the changes of missions."""
    seconds, n_messages, n_transfers = (
        drawn.uniform(3.0, 65.0),
        drawn.randrange(30, 200),
        drawn.randrange(60),
    )
    choice = drawn.random()
    if choice < 0.3:
        return at(seconds)
    if choice < 0.4:
        return lambda _now, sent: sent.messages >= n_messages
    return lambda now, sent: sent.transfers > n_transfers or now >= 65.0


def rounds(kind: str, n: int) -> list[object]:
    """Return parameters of `n` rounds with 10 draws each."""
    return [
        pytest.param(kind, range(10 * i, 10 * i + 10), id=f"{kind} {i}", marks=pytest.mark.full)
        for i in range(1, n + 1)
    ]


@pytest.mark.parametrize(
    ("kind", "draws"),
    [
        pytest.param("ardupilot", [7], id="ardupilot"),
        *rounds("ardupilot", 3),
        *rounds("px4", 3),
        *rounds("lossy", 2),
        *rounds("arduplane", 1),
    ],
)
def test_a_station_that_dies_at_any_moment_is_continued(kind: str, draws: range, tmp_path: Path) -> None:
    for draw in draws:
        drawn = random.Random(f"{kind} {draw}")
        moment, outage_s = drawn_moment(drawn), drawn.choice(OUTAGES_S)
        scenario = pair("ardupilot" if kind == "lossy" else kind)
        trouble = Trouble(faults=LOSSY if kind == "lossy" else [])
        folder = tmp_path / f"{draw}"
        with crashed(scenario, folder, when=moment, trouble=trouble) as crash:
            resumed = resume(scenario, crash, tmp_path / f"{draw}-on", outage_s=outage_s)
        story = f"{kind} {draw}: crash {crash.at_s:.1f} s, silent {outage_s} s: {resumed.ui.said}"
        # A plane stays armed on the ground if its launch is cut off; a copter disarms itself and is launched.
        aborted = [o for o in resumed.outcomes().values() if o.startswith("launch aborted")]
        assert kind == "arduplane" or not aborted, story
        assert {*resumed.outcomes().values()} - {*aborted} <= {"arrived"}, story
        assert resumed.broken_rules() == [], story
        assert lost_observations(resumed) == [], story


@pytest.mark.full
def test_the_record_goes_on_and_both_runs_stay_valid(tmp_path: Path) -> None:
    """A second crash, in the run that went on after the first: its record alone has the whole flight."""
    scenario = pair()
    with crashed(scenario, tmp_path / "a", when=at(20.0)) as first:
        drift(first, 5.0)
        run = unfinished(scenario, first)
        options = replace(DEFAULT_OPTIONS, resumes=run)
        moment = at(first.at_s + 20.0)
        second_run = crashed(scenario, tmp_path / "b", when=moment, options=options, earlier=first)
        with run.file, second_run as second:
            resumed = resume(scenario, second, tmp_path / "c")
    assert set(resumed.outcomes().values()) == {"arrived"}
    assert resumed.broken_rules() == []
    assert lost_observations(resumed) == []
    assert resumed.report.summary["continues"] == "b-crash"
    assert len(list(events(tmp_path / "c", "Restarted", "uav1"))) == 2
    for folder in (tmp_path / "c", first.folder, second.folder):
        assert record.replay(folder / "run.mcap").difference == ""
    with (
        (tmp_path / "c" / "evidence.jsonl").open("rb") as ours,
        (second.folder / "evidence.jsonl").open("rb") as earlier,
    ):
        checked, before = check(ours), check(earlier)
    assert checked.opened.continues == Continued("b-crash", len(before.entries), before.last_hash)


def select_mode(mode: str) -> Meanwhile:
    """Return another station's choice of a mode for the first vehicle."""

    return lambda fleet, now: another_station_sends(fleet, mode_message(1, MODES[mode]), now)


def land(fleet: Fleet) -> None:
    if fleet.vehicles[0].mode.number == MODES["GUIDED"]:
        select(1, "LAND")(fleet)


def reboot(fleet: Fleet, now: float) -> None:
    fleet.inject(parse_fault("reboot"), now)


def skip(fleet: Fleet, now: float) -> None:
    """Let another station set the first vehicle's current item."""
    number = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
    message = mavlink.MAVLink_command_long_message(1, 1, number, 0, 2.0, *[0.0] * 6)
    another_station_sends(fleet, message, now)


@pytest.mark.full
@pytest.mark.parametrize(
    ("meanwhile", "outcome"),
    [
        pytest.param(select_mode("RTL"), "in mode RTL", id="return"),
        pytest.param(select_mode("GUIDED"), "in mode GUIDED", id="hold"),
        pytest.param(skip, "arrived", id="item"),  # its mission leads to its goal
        pytest.param(reboot, "rebooted", id="reboot"),
    ],
)
def test_a_vehicle_that_another_station_touched_is_let_go(
    meanwhile: Meanwhile, outcome: str, tmp_path: Path
) -> None:
    scenario = pair()

    with crashed(scenario, tmp_path / "a", when=at(40.0)) as crash:
        # A vehicle that its pilot holds has to land some time, or the flight does not end.
        lands = (crash.at_s + 30.0, land)
        resumed = resume(scenario, crash, tmp_path / "b", meanwhile=meanwhile, later=lands)
    said = resumed.ui.said
    assert any(line.endswith("[not-taken-over]") and line.startswith("uav1") for line in said), said
    assert outcome in resumed.outcomes()["uav1"]
    given = [entry["now_s"] for entry in effects(resumed.folder, "Command", "uav1")]
    assert max(given) < crash.at_s
    assert [line for line in resumed.broken_rules() if line.endswith("[order]")] == []


@pytest.mark.full
@pytest.mark.parametrize("returns_after_s", [20.0, None], ids=["late", "never"])
def test_a_vehicle_that_does_not_answer_delays_no_other(
    returns_after_s: float | None, tmp_path: Path
) -> None:
    scenario = pair()
    with crashed(scenario, tmp_path / "a", when=at(30.0)) as crash:
        begins_s = crash.at_s + 5.0
        lasts = "" if returns_after_s is None else f",for={5.0 + returns_after_s}"
        crash.fleet.inject(parse_fault(f"link_outage:sysid=2{lasts}"), crash.at_s)
        resumed = resume(scenario, crash, tmp_path / "b")
    (taken_s, *_) = (entry["now_s"] for entry in events(resumed.folder, "Restarted", "uav1"))
    assert taken_s < begins_s + 5.0
    assert resumed.outcomes()["uav1"] == "arrived"
    if returns_after_s is None:
        assert coded(resumed.ui.said, "uav2", "given-up")
    else:
        assert resumed.outcomes()["uav2"] == "arrived"


@pytest.mark.full
def test_a_second_sender_with_the_id_of_one_vehicle_stops_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario, made = pair(), app.run_tasks

    async def run_tasks(flight: Flight) -> Ending:
        flight.vehicles[1].runner.on_link_event(SystemIdConflict("udp://10.0.0.1:14550"))
        return await made(flight)

    with crashed(scenario, tmp_path / "a", when=at(30.0)) as crash:
        monkeypatch.setattr(app, "run_tasks", run_tasks)
        resumed = resume(scenario, crash, tmp_path / "b")
    assert resumed.report.ended == "ended"
    assert resumed.outcomes()["uav1"] == "arrived"
    assert coded(resumed.ui.said, "uav2", "not-taken-over")


@pytest.mark.full
def test_without_the_permission_no_vehicle_is_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = pair()
    with crashed(scenario, tmp_path / "a", when=at(30.0)) as crash:
        monkeypatch.setattr(mavlink_events, "SIMULATOR_MARK", b"another autopilot")
        resumed = resume(scenario, crash, tmp_path / "b")
    assert resumed.report.ended == "failed"
    assert all(line.endswith("[not-simulated]") for line in resumed.report.trouble)
    assert max(entry["now_s"] for entry in effects(resumed.folder, "Command")) < crash.at_s
    assert all(entry["event"]["reason"] for entry in events(resumed.folder, "Restarted"))


def dead(folder: Path, at_s: float) -> tuple[Scenario, Crash]:
    """Return the scenario and the files of a station that died at this time."""
    scenario = pair()
    with crashed(scenario, folder / "a", when=at(at_s)) as crash:
        return scenario, crash


def cut(data: bytes) -> bytes:
    return data[:4]


def changed(data: bytes) -> bytes:
    return data.replace(b'"opened"', b'"OPENED"', 1)


@pytest.mark.parametrize(
    ("name", "change", "code"),
    [("run.mcap", cut, "damaged"), ("evidence.jsonl", changed, "evidence-changed")],
)
def test_a_run_with_changed_files_is_refused(
    name: str,
    change: Callable[[bytes], bytes],
    code: str,
    tmp_path: Path,
) -> None:
    scenario, crash = dead(tmp_path, 1.0)
    file = crash.folder / name
    file.write_bytes(change(file.read_bytes()))
    with pytest.raises((UnfinishedRunError, record_file.RecordError), match=rf"\[{code}\]"):
        unfinished(scenario, crash)


def test_a_record_that_ends_long_before_the_commands_is_refused(tmp_path: Path) -> None:
    """A full disk ended the record, and later there was room for more evidence."""
    scenario, crash = dead(tmp_path, 30.0)
    file = crash.folder / "run.mcap"
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 4])
    with pytest.raises(UnfinishedRunError, match=r"\[record-incomplete\]"):
        unfinished(scenario, crash)
    file.write_bytes(whole)
    evidence = crash.folder / "evidence.jsonl"
    evidence.write_bytes(evidence.read_bytes()[:-9])
    unfinished(scenario, crash).file.close()


def test_a_run_that_is_still_flown_is_refused(tmp_path: Path) -> None:
    scenario, crash = dead(tmp_path, 1.0)
    with (crash.folder / "run.mcap").open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(UnfinishedRunError, match=r"\[still-running\]"):
            unfinished(scenario, crash)
    unfinished(scenario, crash).file.close()


def test_what_the_other_program_wrote_until_its_end_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario, crash = dead(tmp_path, 1.0)
    path = crash.folder / "run.mcap"
    whole, lock = path.read_bytes(), record_file.lock

    def lock_at_its_end(file: BinaryIO) -> bool:
        path.write_bytes(whole)
        return lock(file)

    with unfinished(scenario, crash).file:
        pass
    n_messages = len(record_file.read(path).messages)
    path.write_bytes(whole[: len(whole) // 2])
    assert len(record_file.read(path).messages) < n_messages
    monkeypatch.setattr(record_file, "lock", lock_at_its_end)
    run = unfinished(scenario, crash)
    with run.file:
        assert len(run.stored.messages) == n_messages


def test_a_run_that_cannot_be_locked_is_refused_but_a_new_flight_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(_file: object, _how: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(record_file.fcntl, "flock", no_locks)
    scenario, crash = dead(tmp_path, 1.0)
    with pytest.raises(UnfinishedRunError, match=r"run\.mcap.*\[no-locks\]"):
        unfinished(scenario, crash)


def test_half_a_copy_of_the_earlier_record_is_not_the_last_run(tmp_path: Path) -> None:
    scenario, crash = dead(tmp_path, 1.0)
    stored, found = record_file.read(crash.folder / "run.mcap"), []

    def copied() -> Iterator[record_file.StoredMessage]:
        """Look amid the copy, where a crash would leave the files as they are."""
        yield from stored.messages
        found.append(unfinished_run.last_run(tmp_path / "new"))

    path = tmp_path / "new" / "b" / "run.mcap"
    path.parent.mkdir(parents=True)
    record.Recorder(path, scenario, 0, replace(stored, messages=copied())).close()
    assert found == [None]
    assert unfinished_run.last_run(tmp_path / "new") == path.parent


def test_ctrl_c_amid_the_takeover_lets_the_vehicles_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario, presses = pair(), interrupts(monkeypatch)
    with crashed(scenario, tmp_path / "a", when=at(20.0)) as crash:
        stop = (crash.at_s + 5.5, lambda _fleet: presses[-1]())
        resumed = resume(scenario, crash, tmp_path / "b", later=stop)
    assert resumed.report.ended == "stopped"
    assert {state.phase for state in resumed.report.states.values()} == {"released"}
    assert max(entry["now_s"] for entry in effects(resumed.folder, "Command")) < crash.at_s
    (stopping,) = [line for line in resumed.ui.said if line.endswith("[stopping]")]
    assert not any(name in stopping for name in resumed.outcomes())
    (released,) = [line for line in resumed.ui.said if line.endswith("[released-in-air]")]
    assert all(name in released for name in resumed.outcomes())

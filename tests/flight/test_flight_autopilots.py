"""Whole flights of PX4 and mixed swarms on the virtual clock."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, fly, small
from pymavlink import mavutil

from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.scenario import build

pytestmark = pytest.mark.virtual

MIXED = Path(__file__).parents[2] / "configs" / "mixed.yaml"
ARDUPILOT, PX4 = 3, 12


def autopilots(folder: Path, names: tuple[str, ...]) -> list[int]:
    """Return MAV_AUTOPILOT of each vehicle, by the heartbeats in its tlog."""
    found = []
    for sysid, name in enumerate(names, start=1):
        log = mavutil.mavlink_connection(str(folder / f"{name}.tlog"))
        while (message := log.recv_match(type="HEARTBEAT")) is not None:
            if message.get_srcSystem() == sysid:
                found.append(message.autopilot)
                break
        log.close()
    return found


def last_minute(file: Path, sysid: int) -> list[Any]:
    """Return a vehicle's messages in the last minute of its tlog."""
    log = mavutil.mavlink_connection(str(file))
    messages = []
    while (message := log.recv_match()) is not None:
        if message.get_srcSystem() == sysid:
            messages.append(message)
    log.close()
    return [message for message in messages if message._timestamp > messages[-1]._timestamp - 60.0]


@pytest.mark.parametrize(
    ("autopilot", "expected"),
    [pytest.param("px4", [PX4, PX4, PX4], marks=pytest.mark.full), ("mixed", [ARDUPILOT, PX4, ARDUPILOT])],
)
def test_a_swarm_of_px4_or_mixed_autopilots_arrives(autopilot, expected, tmp_path: Path) -> None:
    simulate = {"count": 3, "ready_s": 3.0, "autopilot": autopilot}
    ui = Ui()
    report = fly(small(simulate=simulate), tmp_path, ui=ui)
    assert report.trouble == ()
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 3
    assert sum(s.plans.replans for s in report.states.values()) > 0
    assert autopilots(tmp_path, ("uav1", "uav2", "uav3")) == expected
    swaps = [vehicle["swaps"] for vehicle in report.summary["vehicles"]]
    assert sum(counts["changed"] for counts in swaps) > 0
    assert all(counts["stood_still"] == 0 for counts in swaps)


@pytest.mark.full
def test_the_shipped_mixed_swarm_arrives(tmp_path: Path) -> None:
    scenario = build(model.load(MIXED, check_config))
    report = fly(scenario, tmp_path)
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 6
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["configuration"]["simulate"]["autopilot"] == "mixed"
    assert autopilots(tmp_path, tuple(f"uav{n}" for n in range(1, 7))) == [ARDUPILOT, PX4] * 3


@pytest.mark.full
def test_a_swarm_with_reduced_telemetry_arrives(tmp_path: Path) -> None:
    simulate = {"count": 2, "ready_s": 3.0, "autopilot": "mixed"}
    scenario = small(seed=4, simulate=simulate, links={"position_hz": 2.0, "stop_other_streams": True})
    report = fly(scenario, tmp_path)
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 2
    assert sum(s.plans.replans for s in report.states.values()) > 0
    for sysid in (1, 2):
        messages = Counter(
            message.get_type() for message in last_minute(tmp_path / f"uav{sysid}.tlog", sysid)
        )
        assert messages["GLOBAL_POSITION_INT"] == pytest.approx(120, abs=5)
        assert messages["ATTITUDE"] == messages["GPS_RAW_INT"] == 0

"""Whole flights of PX4 and mixed swarms on the virtual clock."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest
from flights import fly, small
from pymavlink.dialects.v20.ardupilotmega import MAV_MODE_FLAG_SAFETY_ARMED
from recorded import first_heartbeats, on_the_wire

from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.scenario import build

pytestmark = pytest.mark.virtual

MIXED = Path(__file__).parents[2] / "configs" / "mixed.yaml"
ARDUPILOT, PX4 = 3, 12


@pytest.mark.parametrize(
    ("autopilot", "expected"),
    [pytest.param("px4", [PX4, PX4, PX4], marks=pytest.mark.full), ("mixed", [ARDUPILOT, PX4, ARDUPILOT])],
)
def test_a_swarm_of_px4_or_mixed_autopilots_arrives(autopilot, expected, tmp_path: Path) -> None:
    simulate = {"count": 3, "ready_s": 3.0, "autopilot": autopilot}
    scenario = small(simulate=simulate)
    report = fly(scenario, tmp_path)
    assert report.trouble == ()
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 3
    assert sum(s.plans.replans for s in report.states.values()) > 0
    assert [m.autopilot for m in first_heartbeats(tmp_path, scenario)] == expected
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
    assert [m.autopilot for m in first_heartbeats(tmp_path, scenario)] == [ARDUPILOT, PX4] * 3


@pytest.mark.full
def test_a_swarm_with_reduced_telemetry_arrives(tmp_path: Path) -> None:
    simulate = {"count": 2, "ready_s": 3.0, "autopilot": "mixed"}
    scenario = small(seed=4, simulate=simulate, links={"position_hz": 2.0, "stop_other_streams": True})
    report = fly(scenario, tmp_path)
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 2
    assert sum(s.plans.replans for s in report.states.values()) > 0
    for sysid in (1, 2):
        sent = [m for m in on_the_wire(tmp_path, f"uav{sysid}") if m.get_srcSystem() == sysid]
        armed_s = [
            m._timestamp
            for m in sent
            if m.get_type() == "HEARTBEAT" and m.base_mode & MAV_MODE_FLAG_SAFETY_ARMED
        ]
        in_last_minute = Counter(m.get_type() for m in sent if 0.0 <= armed_s[-1] - m._timestamp < 60.0)
        assert in_last_minute["GLOBAL_POSITION_INT"] == pytest.approx(120, abs=5)
        assert in_last_minute["ATTITUDE"] == in_last_minute["GPS_RAW_INT"] == 0

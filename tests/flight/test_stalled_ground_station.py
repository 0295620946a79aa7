"""Whole flights with a ground station that stands still for seconds, in every phase after the connection."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from flights import Ui, coded, fly, small
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples
from trouble import Trouble

from sim_vehicle.fleet import Fleet
from sim_vehicle.truth import Truth
from swarmctl.agent.state import ARRIVED
from swarmctl.core.geo import distance_m
from swarmctl.flight.virtual_clock import VirtualTimeLoop

UNDISTURBED_M = {1: 485.0, 2: 434.0, 3: 483.0}
"""ways flown without a stall"""
CONNECTED_S = 5.0
"""time by which the vehicles are connected: a stall before ends the start of the program, with a message"""
LONGER_M = 60.0
"""greatest way beyond the undisturbed one: a change that was due in a stall comes later, or not at all"""


def stall(seconds: float) -> Callable[[Fleet], None]:
    """Return an action: the loop does nothing for `seconds`, and then finds all that has come in between."""

    def action(_fleet: Fleet) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.advance(seconds)

    return action


class Tracks:
    """The lengths of the true tracks."""

    def __init__(self) -> None:
        self.flown_m: dict[int, float] = {}
        self._last: dict[int, tuple[float, float]] = {}

    def watch(self, _now: float, truth: Truth) -> None:
        places = zip(truth.lat_deg.tolist(), truth.lon_deg.tolist(), strict=True)
        for sysid, here in zip(truth.sysid, places, strict=True):
            last, self._last[int(sysid)] = self._last.get(int(sysid), here), here
            self.flown_m[int(sysid)] = self.flown_m.get(int(sysid), 0.0) + distance_m(last, here)


@settings(
    deadline=None,
    derandomize=True,
    max_examples=examples(9, 1),
    suppress_health_check=list(HealthCheck),
    database=None,
)
@given(
    stalls=st.lists(
        st.tuples(st.floats(CONNECTED_S, 100.0), st.sampled_from([1.0, 5.0, 20.0])), min_size=1, max_size=3
    ),
    loss=st.sampled_from([0.0, 0.15]),
)
def test_every_vehicle_flies_on_to_its_goal_and_the_operator_is_told(
    stalls: list[tuple[float, float]], loss: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    tracks = Tracks()
    trouble = Trouble(
        faults=[{"fault": "packet_loss", "params": {"rate": loss}}] if loss else [],
        actions=[(at_s, stall(seconds)) for at_s, seconds in stalls],
        on_step=tracks.watch,
    )
    folder: Path = tmp_path_factory.mktemp("run")
    ui = Ui()
    report = fly(small(), folder, trouble=trouble, ui=ui)
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 3
    for uav, way_m in UNDISTURBED_M.items():
        assert tracks.flown_m[uav] < way_m + LONGER_M
        lengths_s = [seconds for at_s, seconds in stalls if 20.0 < at_s < 60.0]
        if max(lengths_s, default=0.0) > 3.0:
            assert coded(ui.said, f"uav{uav}", "telemetry-old")

"""The loop that refreshes the user interface during a flight."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence

from swarmctl.bus.network import Network
from swarmctl.config.scenario import Scenario
from swarmctl.flight.director import Director
from swarmctl.flight.member import Member
from swarmctl.report.live_rows import SwarmView, vehicle_row
from swarmctl.report.summary import FlightStatistics
from swarmctl.report.ui import Ui

REFRESH_S = 0.25


async def show(
    members: Sequence[Member],
    statistics: FlightStatistics,
    ui: Ui,
    scenario: Scenario,
    director: Director,
    network: Network,
) -> None:
    """Refresh the user interface several times a second until cancelled, and once more at the end."""
    marks: list[tuple[float, float]] = []

    def refresh() -> None:
        nonlocal marks
        clocks = [m.state.vehicle.time_boot_s for m in members]
        marks = [*marks[-20:], (time.monotonic(), max(clocks, default=0.0))]
        (t0, v0), (t1, v1) = marks[0], marks[-1]
        rows = [
            vehicle_row(
                m.state,
                m.runner.link.age_s(),
                "; ".join(m.waiting_for) if m.is_overdue else "",
                network.counters(m.spec.sysid).refused.total(),
                lost_timeout_s=scenario.config.flight.lost_timeout_s,
            )
            for m in members
        ]
        speed = (v1 - v0) / (t1 - t0) if t1 > t0 and v0 > 0.0 else None
        ui.refresh(SwarmView(scenario.config.name, statistics.flown_s, speed, rows, director.on_ctrl_c))

    try:
        while True:
            refresh()
            await asyncio.sleep(REFRESH_S)
    finally:
        refresh()

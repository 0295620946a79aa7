"""The measures of one vehicle in one mission. Pure."""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.config.scenario import Scenario
from swarmctl.core import exposure as measures
from swarmctl.core.any_angle.pull import Track
from swarmctl.planners.base import Route
from swarmctl.study.tables import SeedResult


class VehicleResult(msgspec.Struct, frozen=True):
    """The measures of one vehicle in one mission.

    A vehicle without a way to a goal stays on the ground: it has not arrived, and its lengths are 0.
    """

    uav: int
    arrived: bool
    length_cells: float
    """length of the flown route, from the centre of the entry cell to that of the goal cell [cells]"""
    length_m: float
    """distance flown, with the way from the start to the entry cell [m]"""
    exposure_sum: float
    """ΣP_s of the flown route by the true hostiles (Eq. 2)"""
    believed_exposure_sum: float
    """ΣP_s of the first route by the belief before the mission (Eq. 3)"""
    safety_factor: float
    """∏(1 − P_s) of the flown route by the true hostiles"""
    believed_safety_factor: float
    """∏(1 − P_s) of the first route by the belief before the mission"""
    strikes: int
    survived: bool
    """True without a strike"""
    searches: int
    """calls of the planner"""
    replans: int
    """changes of the route"""
    messages_sent: int
    """observations sent, counted for each receiver"""
    messages_received: int
    penalty: float
    """communication penalty, by the distance flown"""
    flight_time_s: float
    """time from the start of the climb to the centre of the goal cell"""
    arrival_s: float
    """time of the arrival after the first start of a vehicle"""
    cells_known: int
    """v, cells observed or told, at the end"""
    hostiles_known: int
    """n_V at the end"""


MissionResult = SeedResult[VehicleResult]


def measured(
    scenario: Scenario,
    i: int,
    first: Route | Track | None,
    p_s: NDArray[np.float64],
    flown: NDArray[np.int64],
    strikes: int,
    arrived_s: float | None,
    track_cells: float | None = None,
    **counts: int,
) -> VehicleResult:
    """Return the measures of the scenario's vehicle `i`.

    `p_s` is by the true hostiles, (rows, cols); `flown` has the cells, (n, 2). `track_cells` is the length
    flown on straightened tracks; None: the length from centre to centre. `counts` are fields of the result.
    Times of a vehicle that has not arrived are NaN.
    """
    task, takeoff_s = scenario.tasks[i], scenario.specs[i].delay_s
    length_cells = measures.length_cells(flown) if track_cells is None else track_cells
    length_m = length_cells * task.grid.cell_size_m + (task.arrival.approach_m if len(flown) else 0.0)
    ends_s = math.nan if arrived_s is None else arrived_s
    return VehicleResult(
        uav=task.uav,
        arrived=arrived_s is not None,
        length_cells=length_cells,
        length_m=length_m,
        exposure_sum=measures.exposure_sum(p_s, flown),
        believed_exposure_sum=0.0 if first is None else first.exposure_sum,
        safety_factor=measures.safety_factor(p_s, flown),
        believed_safety_factor=1.0 if first is None else first.safety_factor,
        strikes=strikes,
        survived=strikes == 0,
        penalty=scenario.config.communication.penalty_per_m * length_m,
        flight_time_s=ends_s - takeoff_s,
        arrival_s=ends_s - min(spec.delay_s for spec in scenario.specs),
        **counts,
    )

"""A session and a vehicle of the simulator."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Self

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from wire_bench import HOME, Faults, WireBench, north_of_home

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.telemetry.streams import UNUSED_IDS

BOTH = pytest.mark.parametrize("personality", ["ardupilot", "px4"])
"""Run a test on each multicopter."""
ALT_M = 300.0
NO_LOGS = {"ardupilot": {"LOG_BACKEND_TYPE": 0.0}, "px4": {"SDLOG_MODE": -1.0}}
"""Parameters of a vehicle that records no flights; an eighth of a flight's time goes into its log."""

__all__ = ["ALT_M", "BOTH", "HOME", "Faults", "FlyingBench", "on_the_ground", "plan"]


def plan(*, north: int = 5, alt: float = 20.0, east: float = 0.0) -> FlightPlan:
    """Return a plan of `north` waypoints 55 m apart going north, with a landing on the last."""
    return north_of_home(north, 0.0005, alt=alt, east=east)


class FlyingBench(WireBench):
    STEP_S = 0.05
    UNUSED_EVERY_S: float | None = 1.0
    """Interval of the streams that a session does not use; None: the vehicle's own interval."""

    def __init__(
        self,
        personality: str,
        kind: str = "copter",
        *,
        params: dict[str, float] | None = None,
        ready_s: float = 1.0,
    ) -> None:
        super().__init__()
        vehicle = {"sysid": 1, "lat_deg": HOME[0], "lon_deg": HOME[1], "alt_amsl_m": ALT_M}
        vehicle |= {"personality": personality, "type": kind, "params": NO_LOGS[personality] | (params or {})}
        self.fleet = Fleet(Scenario.model_validate({"seed": 1, "vehicles": [vehicle]}), ready_s=ready_s)
        self.vehicle = self.fleet.vehicles[0]
        self._other = mavlink.MAVLink(None, srcSystem=254, srcComponent=190)

    def vehicle_receives(self, data: bytes) -> Iterable[bytes]:
        return [frame for _, frame in self.fleet.receive(data, self.now, peer="station")]

    def vehicle_steps(self) -> Iterable[bytes]:
        return [frame for _, frame in self.fleet.step(self.now)]

    def connected(self) -> Self:
        super().connected()
        rates = self.vehicle.rates
        for msgid in UNUSED_IDS if self.UNUSED_EVERY_S else ():
            if rates.interval_s(msgid) is not None:
                rates.set(msgid, self.UNUSED_EVERY_S, self.now)
        return self

    def inject(self, fault: str) -> None:
        """Inject a fault from now on, written as on the simulator's command line."""
        self.fleet.inject(parse_fault(fault), self.now)

    def another_sends(self, message: Any) -> None:
        """Send a message from another ground station; the session receives the answers as well."""
        data = message.pack(self._other)
        self._down(frame for _, frame in self.fleet.receive(data, self.now, peer="other"))

    def another_commands(self, number: int, *params: float) -> None:
        rest = (0.0,) * (7 - len(params))
        self.another_sends(mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *rest))

    def another_sets_mode(self, mode: str) -> None:
        self.another_commands(mavlink.MAV_CMD_DO_SET_MODE, *self.session.dialect.mode_params(mode))

    def another_sets(self, **params: float) -> None:
        for name, value in params.items():
            kind = mavlink.MAV_PARAM_TYPE_REAL32
            self.another_sends(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind))

    # true state of the vehicle

    @property
    def params(self) -> Any:
        return self.vehicle.params

    @property
    def mode(self) -> str:
        """The vehicle's true mode, by the ground station's name."""
        return self.session.dialect.mode_name(self.vehicle.mode.number)

    @property
    def stored(self) -> tuple[MissionItem, ...]:
        """The mission in the vehicle's memory."""
        mission = self.vehicle.mission
        items = (mission.item(i) for i in range(mission.count))
        return tuple(
            MissionItem(i.command, i.frame, i.x, i.y, i.z, i.param1, i.param2, i.param3, i.param4)
            for i in items
        )

    def watched_swap(self, new: FlightPlan) -> tuple[basic.Swapped, set[str], set[tuple[int, int] | None]]:
        """Return the result of a swap, the modes during it and the positions aimed at."""
        modes, aims = set(), set()

        def watch() -> bool:
            modes.add(self.mode)
            aims.add(self.aim)
            return self.session.busy_with is None

        self.begin_swap(new)
        assert self.run(300, watch), "the swap does not end"
        return self.result, modes, aims

    def holds(self, items: tuple[MissionItem, ...]) -> bool:
        return bool(items) and self.session.dialect.differences(items, self.stored) == ()

    @property
    def aim(self) -> tuple[int, int] | None:
        """The position (degE7) of the flown item; None without a flown item or without a position."""
        flown = self.vehicle.mission.current_item
        flies = flown is not None and self.mode == self.session.dialect.mission_mode
        return (flown.x, flown.y) if flies and flown.x else None


def on_the_ground(
    personality: str, *, loss: float = 0.0, seed: int = 0, params: dict[str, float] | None = None
) -> FlyingBench:
    """Return a disarmed vehicle on the ground after a second of contact; then the wire has this loss."""
    bench = FlyingBench(personality, params=params, ready_s=0.0).connected()
    bench.run(1.0)
    bench.spoil(Faults(loss=loss, seed=seed))
    return bench

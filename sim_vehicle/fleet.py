"""The whole fleet without I/O: bytes of ground stations and simulated time in, bytes of vehicles out."""

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.autopilot import Autopilot
from sim_vehicle.geodesy import Floats, LocalFrame
from sim_vehicle.personalities import PERSONALITIES
from sim_vehicle.scenario import Scenario
from sim_vehicle.threats import OUTSIDE, Threats
from sim_vehicle.world import Body, World

TICK_S = 0.05
TICKS_PER_DECISION = 2
Frames = list[tuple[int, bytes]]


@dataclass(frozen=True, slots=True)
class Truth:
    """Where everything really is, one entry a vehicle in the scenario's order."""

    sysid: npt.NDArray[np.int64]
    lat_deg: Floats
    lon_deg: Floats
    alt_amsl_m: Floats
    height_m: Floats  # above the ground
    speed_m_s: Floats  # horizontal
    airborne: npt.NDArray[np.bool_]
    armed: npt.NDArray[np.bool_]
    battery_remaining: Floats  # share, in [0, 1]
    strikes: npt.NDArray[np.int64]
    mode: tuple[str, ...]


@dataclass
class Counters:
    """What came in from ground stations."""

    bytes_in: int = 0
    messages_in: int = 0
    bad_data: int = 0
    unknown_messages: int = 0


class Fleet:
    """All vehicles of a scenario under one simulated clock that starts at 0.

    Physics and telemetry advance in fixed ticks of 0.05 s, however often `step` is called, so equal inputs at
    equal times give equal bytes.
    """

    def __init__(self, scenario: Scenario, *, ready_s: float = 41.0) -> None:
        """`ready_s`: from boot to a position estimate [s]; 0 is at once."""
        specs = scenario.vehicles
        area = scenario.area
        centre = (area.origin_lat_deg, area.origin_lon_deg) if area else (specs[0].lat_deg, specs[0].lon_deg)
        self._world = World(
            LocalFrame(*centre),
            np.array([spec.lat_deg for spec in specs]),
            np.array([spec.lon_deg for spec in specs]),
            np.array([spec.alt_amsl_m for spec in specs]),
        )
        generators = np.random.default_rng(scenario.seed).spawn(len(specs))
        self._vehicles = [
            Autopilot(
                spec.sysid,
                Body(self._world, index),
                PERSONALITIES["ardupilot"],
                spec.params,
                ready_s=ready_s,
                rng=generators[index],
            )
            for index, spec in enumerate(specs)
        ]
        self._threats: Threats | None = None
        if area is not None and scenario.firing_strength is not None:
            self._threats = Threats(
                area.rows, area.cols, area.cell_size_m, scenario.firing_strength, scenario.hostiles
            )
        self._cells = np.full(len(specs), OUTSIDE)
        self._next_tick = 0
        self._parsers: dict[Hashable, mavlink.MAVLink] = {}
        self.counters = Counters()

    @property
    def sysids(self) -> tuple[int, ...]:
        return tuple(vehicle.sysid for vehicle in self._vehicles)

    def boots(self) -> dict[int, int]:
        """How often each vehicle has booted, by system id."""
        return {vehicle.sysid: vehicle.boots for vehicle in self._vehicles}

    def receive(self, data: bytes, now: float, *, peer: Hashable = None) -> Frames:
        """Take bytes of one ground station at `now` [s] and return (system id, bytes) to send.

        Bytes of one stream may be cut anywhere; `peer` tells streams apart where there are several. The
        simulation is brought up to `now` first, and what that sends is returned as well.
        """
        out = self.step(now)
        self.counters.bytes_in += len(data)
        for message in self._parser(peer).parse_buffer(data) or ():
            kind = message.get_type()
            if kind == "BAD_DATA":
                self.counters.bad_data += 1
            elif kind.startswith("UNKNOWN_"):
                self.counters.unknown_messages += 1
            else:
                self.counters.messages_in += 1
                target = getattr(message, "target_system", 0)
                for vehicle in self._vehicles:
                    if target in (0, vehicle.sysid):
                        vehicle.receive(message, now)
        self._collect(out)
        return out

    def forget_peer(self, peer: Hashable) -> None:
        """A stream ended; what it left half-sent is dropped."""
        self._parsers.pop(peer, None)

    def step(self, now: float) -> Frames:
        """Run physics and streams up to `now` [s since the fleet started]; (system id, bytes) to send."""
        out: Frames = []
        while self._next_tick * TICK_S <= now + 1e-9:
            self._tick(self._next_tick * TICK_S)
            self._next_tick += 1
            self._collect(out)
        return out

    def positions(self) -> Truth:
        """The truth, for tests and displays; no vehicle or ground station sees it."""
        dynamics = self._world.dynamics
        lat_deg, lon_deg = self._world.geodetic()
        return Truth(
            sysid=np.array(self.sysids),
            lat_deg=lat_deg.copy(),
            lon_deg=lon_deg.copy(),
            alt_amsl_m=dynamics.position_m[:, 2].copy(),
            height_m=dynamics.position_m[:, 2] - dynamics.ground_m,
            speed_m_s=np.hypot(dynamics.velocity_m_s[:, 0], dynamics.velocity_m_s[:, 1]),
            airborne=dynamics.airborne.copy(),
            armed=self._world.armed.copy(),
            battery_remaining=self._world.batteries.remaining.copy(),
            strikes=np.array([vehicle.strikes for vehicle in self._vehicles]),
            mode=tuple(vehicle.mode.name for vehicle in self._vehicles),
        )

    def _parser(self, peer: Hashable) -> mavlink.MAVLink:
        if peer not in self._parsers:
            self._parsers[peer] = mavlink.MAVLink(None)
            self._parsers[peer].robust_parsing = True
        return self._parsers[peer]

    def _collect(self, out: Frames) -> None:
        for vehicle in self._vehicles:
            out.extend((vehicle.sysid, frame) for frame in vehicle.drain())

    def _tick(self, now: float) -> None:
        if self._next_tick > 0:
            self._world.step(TICK_S)
            self._fire()
        if self._next_tick % TICKS_PER_DECISION == 0:
            for vehicle in self._vehicles:
                vehicle.update(now)
        for vehicle in self._vehicles:
            vehicle.stream(now)

    def _fire(self) -> None:
        """Each vehicle in the air that has entered another cell is fired at."""
        if self._threats is None:
            return
        dynamics = self._world.dynamics
        cells = np.where(dynamics.airborne, self._threats.cells(dynamics.position_m), OUTSIDE)
        for index in np.flatnonzero((cells != self._cells) & (cells != OUTSIDE)).tolist():
            vehicle, cell = self._vehicles[index], int(cells[index])
            for hostile in self._threats.fire(cell, vehicle.rng):
                vehicle.struck(self._threats.row_col(cell), hostile)
        self._cells = cells

"""A fleet of simulated vehicles without I/O: the input is bytes and simulated time, the output is bytes."""

from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.faults.base import VehicleAccess
from sim_vehicle.faults.schedule import Schedule
from sim_vehicle.faults.spec import FaultSpec
from sim_vehicle.files.logs.recorder import NO_LOGS, limits_for
from sim_vehicle.files.logs.sampling import samples
from sim_vehicle.personalities import personality_of
from sim_vehicle.physics.body import Body
from sim_vehicle.physics.geodesy import LocalFrame
from sim_vehicle.physics.gps import GpsSettings
from sim_vehicle.physics.threats import OUTSIDE, Threats
from sim_vehicle.physics.wind import WindSettings
from sim_vehicle.physics.world import World
from sim_vehicle.scenarios import Scenario
from sim_vehicle.truth import Truth
from sim_vehicle.vehicle.autopilot import Autopilot
from sim_vehicle.vehicle.injected_faults import FaultEffectWriter, InjectedFaults
from sim_vehicle.vehicle.receivers import COMPONENT
from sim_vehicle.wire.link_layer import LinkLayer
from sim_vehicle.wire.outbox import Frames, Outbox
from sim_vehicle.wire.parser import Parser
from sim_vehicle.wire.status import Status
from sim_vehicle.wire.streams import Streams
from sim_vehicle.wire.telemetry import View

TICK_S = 0.05  # period of physics and telemetry
TICKS_PER_DECISION = 2


@dataclass
class Counters:
    """Counts of the input from ground stations."""

    bytes_in: int = 0
    messages_in: int = 0
    bad_data: int = 0
    unknown_messages: int = 0


class Fleet:
    """All vehicles of a scenario under one simulated clock that starts at 0.

    Physics and telemetry advance in fixed ticks of 0.05 s, independent of the calls of `step`. Equal inputs
    at equal times give equal bytes of each vehicle. Equal calls of `step` give an equal order of vehicles.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        ready_s: float | None = None,
        trusted_links: Collection[int] = (),
        keeps_logs: bool = True,
    ) -> None:
        """Create the vehicles of a scenario.

        Parameters
        ----------
        scenario: vehicles, area, faults and environment.
        ready_s: time from boot to a position estimate [s]; None: the scenario's time, else the autopilot's.
        trusted_links: links on which vehicles with a signing key accept unsigned messages, as on USB.
        keeps_logs: False if no station downloads flight logs; the vehicles then record none.
        """
        specs = scenario.vehicles
        self.scenario = scenario
        generators = np.random.default_rng(scenario.seed).spawn(len(specs))
        self.world = _world(scenario, [generator.spawn(1)[0] for generator in generators])
        self.status = Status(len(specs))
        self.sysids = tuple(spec.sysid for spec in specs)
        self.links = tuple(spec.link for spec in specs)
        self._streams = Streams(len(specs), TICK_S)
        self._outbox = Outbox(self.sysids, COMPONENT, self.world, self.status)
        chosen_s = ready_s if ready_s is not None else scenario.ready_s
        log_limits = limits_for(len(specs)) if keeps_logs else NO_LOGS
        self.vehicles: list[Autopilot] = []
        for index, spec in enumerate(specs):
            personality = personality_of(spec.personality, spec.kind)
            self.vehicles.append(
                Autopilot(
                    index,
                    spec.sysid,
                    Body(self.world, index),
                    personality,
                    dict(spec.params),
                    ready_s=personality.ready_s if chosen_s is None else chosen_s,
                    rng=generators[index],
                    status=self.status,
                    streams=self._streams,
                    output=self._outbox,
                    injected_faults=InjectedFaults(
                        generators[index].spawn(1)[0], FaultEffectWriter(self.world, self.status, index)
                    ),
                    replace_faults=partial(self._replace_faults, index),
                    log_limits=log_limits,
                )
            )
        self._by_address: dict[tuple[int, int], Autopilot] = {}
        self._by_link: dict[int, list[Autopilot]] = {}
        for vehicle, link in zip(self.vehicles, self.links, strict=True):
            self._by_address[link, vehicle.sysid] = vehicle
            self._by_link.setdefault(link, []).append(vehicle)
        self._alarm_s = np.zeros(len(specs))
        self._link_layer = LinkLayer(
            [vehicle.signing for vehicle in self.vehicles], self.links, trusted_links
        )
        self._ready_frames: Frames = []  # frames for the next result of `receive` or `step`
        self._schedule = Schedule(scenario.faults, self.sysids, self._access, scenario.seed)
        self._threats: Threats | None = None
        area = scenario.area
        if area is not None and scenario.firing_strength is not None:
            self.status.threatened[:] = bool(scenario.hostiles)
            self._threats = Threats(
                area.rows, area.cols, area.cell_size_m, scenario.firing_strength, scenario.hostiles
            )
        self._cells = np.full((2, len(specs)), OUTSIDE)
        self._next_tick = 0
        self._parsers: dict[Hashable, Parser] = {}
        self.counters = Counters()
        for vehicle, spec in zip(self.vehicles, specs, strict=True):
            for name in spec.params:
                vehicle.update_parameter_faults(name)

    def boots(self) -> tuple[int, ...]:
        """Return the number of boots of each vehicle."""
        return tuple(vehicle.boots for vehicle in self.vehicles)

    def receive(
        self,
        data: bytes,
        now: float,
        *,
        peer: Hashable = None,
        link: int = 0,
        reach: Collection[int] | None = None,
    ) -> Frames:
        """Advance to `now` [s] and process bytes of one station; return (vehicle index, bytes) to send.

        peer: stream of the bytes; a message can span several calls.
        link: only vehicles on this link receive the bytes.
        reach: indices of the vehicles in reach; None: all.
        """
        self._advance(now)
        self.counters.bytes_in += len(data)
        for message in self._parser((link, peer)).feed(data):
            kind = message.get_type()
            if kind == "BAD_DATA":
                self.counters.bad_data += 1
            elif kind.startswith("UNKNOWN_"):
                self.counters.unknown_messages += 1
            else:
                self.counters.messages_in += 1
                self._deliver(message, link, reach, now)
        return self._take(now)

    def _deliver(self, message: Any, link: int, reach: Collection[int] | None, now: float) -> None:
        target = getattr(message, "target_system", 0)
        if target:
            vehicle = self._by_address.get((link, target))
            on_link = self._by_link.get(link, [])
            # A message to an unknown system reaches a vehicle that is alone on its link, as without a router.
            addressed = [vehicle] if vehicle is not None else on_link if len(on_link) == 1 else []
        else:
            addressed = self._by_link.get(link, [])
        for vehicle in addressed:
            if reach is not None and vehicle.index not in reach:
                continue
            if not self._link_layer.put_incoming(vehicle.index, message, now):
                self._deliver_one(vehicle, message, now)

    def _deliver_one(self, vehicle: Autopilot, message: Any, now: float) -> None:
        """Deliver a message to a vehicle, if the vehicle accepts the signature."""
        if not self._link_layer.accepts(vehicle.index, message):
            return
        vehicle.receive(message, now)
        self._alarm_s[vehicle.index] = vehicle.alarm_s
        if message.get_msgId() == mavlink.MAVLINK_MSG_ID_SETUP_SIGNING:
            self._send_pending(now)
            self._link_layer.update_signing(vehicle.index)

    def forget_peer(self, peer: Hashable, *, link: int = 0) -> None:
        """Delete the incomplete message of an ended stream."""
        self._parsers.pop((link, peer), None)

    @property
    def waiting_bytes(self) -> int:
        """Return the size of the incomplete messages of all streams [bytes]."""
        return sum(parser.waiting_bytes for parser in self._parsers.values())

    def step(self, now: float) -> Frames:
        """Run the simulation up to `now` [s since the start]; return (vehicle index, bytes) to send."""
        self._advance(now)
        return self._take(now)

    def inject(self, spec: FaultSpec, now: float, indices: Sequence[int] | None = None) -> None:
        """Begin a fault `spec.at_s` [s] after `now` [s]; raise FaultError for an unknown vehicle.

        indices: the vehicles; None: the system ids of `spec`, on every link.
        """
        self._advance(now)
        self._send_pending(now)
        self._schedule.inject(spec, now, indices)

    def faults_on(self, index: int) -> tuple[str, ...]:
        """Return the names of a vehicle's running faults."""
        return self._schedule.names(index)

    def truth(self) -> Truth:
        """Return the true state of all vehicles, without errors of sensors and estimators."""
        dynamics = self.world.dynamics
        lat_deg, lon_deg = self.world.geodetic()
        return Truth(
            sysid=np.array(self.sysids),
            lat_deg=lat_deg.copy(),
            lon_deg=lon_deg.copy(),
            alt_amsl_m=dynamics.position_m[:, 2].copy(),
            height_m=dynamics.position_m[:, 2] - dynamics.ground_m,
            speed_m_s=np.hypot(dynamics.velocity_m_s[:, 0], dynamics.velocity_m_s[:, 1]),
            airborne=dynamics.airborne.copy(),
            armed=self.world.armed.copy(),
            crashed=dynamics.crashed.copy(),
            battery_remaining=self.world.batteries.remaining.copy(),
            strikes=self.status.strikes.astype(np.int64),
            mode=tuple(vehicle.mode.name for vehicle in self.vehicles),
        )

    def _parser(self, peer: Hashable) -> Parser:
        if peer not in self._parsers:
            self._parsers[peer] = Parser()
        return self._parsers[peer]

    def _advance(self, now: float) -> None:
        while self._next_tick * TICK_S <= now + EPSILON_S:
            tick_s = self._next_tick * TICK_S
            self._deliver_arrivals(tick_s)
            self._tick(tick_s)
            if not self._link_layer.frames_pass_unchanged:
                self._send_pending(tick_s)
            self._next_tick += 1
        self._deliver_arrivals(now)

    def _tick(self, now: float) -> None:
        if self._next_tick > 0:
            self.world.step(TICK_S)
            self._fire(now)
        if self._schedule.next_due_s <= now + EPSILON_S:
            self._send_pending(now)
            self._schedule.tick(now)
        if self._next_tick % TICKS_PER_DECISION == 0:
            self._decide(now)
            self._record(now)
        self._outbox.stream(self._streams, now)

    def _decide(self, now: float) -> None:
        """Update the vehicles with an event or a due alarm."""
        due = (self._alarm_s <= now + EPSILON_S) | self.world.has_event
        for index in np.flatnonzero(due).tolist():
            vehicle = self.vehicles[index]
            vehicle.decide(now, has_event=vehicle.body.take_events())
            self._alarm_s[index] = vehicle.alarm_s

    def _record(self, now: float) -> None:
        """Sample the vehicles whose flight logs are due."""
        due = [vehicle.index for vehicle in self.vehicles if vehicle.storage.recorder.due(now)]
        if due:
            view = View(self.world, self.status, np.array(due), now)
            for index, sample in zip(due, samples(view), strict=True):
                self.vehicles[index].storage.recorder.sample(now, sample)

    # -- faults and impaired links ------------------------------------------------------------------------

    def _access(self, index: int) -> VehicleAccess:
        vehicle = self.vehicles[index]
        return VehicleAccess(
            partial(self._link_layer.channel, index), vehicle.injected_faults, partial(self._reboot, index)
        )

    def _reboot(self, index: int, now: float, silence_s: float) -> None:
        self.vehicles[index].reboot(now, silence_s)
        self._alarm_s[index] = now

    def _replace_faults(self, index: int, key: Hashable, specs: Sequence[FaultSpec], now: float) -> None:
        self._send_pending(now)
        self._schedule.replace(index, key, specs, now)

    def _deliver_arrivals(self, now: float) -> None:
        """Deliver the messages that have passed impaired links by `now` [s], and send the answers."""
        for due_s, index, message in self._link_layer.arrivals_at_vehicles(now):
            if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN_"):
                self._deliver_one(self.vehicles[index], message, due_s)
                self._send_pending(due_s)

    def _send_pending(self, now: float) -> None:
        """Send the vehicles' pending messages at `now` [s], signed if required."""
        self._ready_frames += self._link_layer.send(self._outbox.take(), now)

    def _take(self, now: float) -> Frames:
        """Return the frames that reach ground stations by `now` [s]."""
        if self._link_layer.frames_pass_unchanged and not self._ready_frames:
            return self._outbox.take()
        self._deliver_arrivals(now)
        self._send_pending(now)
        frames, self._ready_frames = self._ready_frames + self._link_layer.arrivals_at_stations(now), []
        return frames

    def _fire(self, now: float) -> None:
        """Fire at each airborne vehicle that has entered another cell."""
        if self._threats is None:
            return
        dynamics = self.world.dynamics
        cells = np.where(dynamics.airborne, self._threats.cells(dynamics.position), OUTSIDE)
        entered = cells != self._cells
        if not np.count_nonzero(entered):
            return
        self._cells = cells
        for index in np.flatnonzero(entered.any(axis=0)).tolist():
            vehicle, (col, row) = self.vehicles[index], cells[:, index].astype(int).tolist()
            if self._threats.contains(row, col):
                for hostile in self._threats.fire(row, col, vehicle.rng):
                    vehicle.record_strike((row, col), hostile, now)


def _world(scenario: Scenario, generators: Sequence[np.random.Generator]) -> World:
    specs, wind, gps = scenario.vehicles, scenario.wind, scenario.gps
    world = World(
        LocalFrame(*scenario.origin_deg),
        np.array([spec.lat_deg for spec in specs]),
        np.array([spec.lon_deg for spec in specs]),
        np.array([spec.alt_amsl_m for spec in specs]),
        planes=np.array([spec.kind == "plane" for spec in specs]),
        rngs=generators,
        wind=WindSettings(wind.speed_m_s, wind.from_deg, wind.gust_m_s),
        gps=GpsSettings(gps.noise_m, gps.drift_m),
    )
    headings_rad = np.deg2rad([spec.heading_deg for spec in specs])
    world.dynamics.attitude[2] = np.arctan2(np.sin(headings_rad), np.cos(headings_rad))
    return world

"""A group of point masses that fly by the laws of formation flight, without MAVLink.

The vehicles follow set-points as docs/simulator/setpoints.md says of ArduCopter and PX4. Messages among the
members come at 10 Hz, late, and by chance not at all.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from swarmctl.agent.formation.approaches import APPROACHES
from swarmctl.agent.formation.approaches.base import (
    ACCELERATION_M_S2,
    Along,
    ApproachResult,
    Group,
    MemberLimits,
    OtherMember,
    PlaceMemory,
    ThreatField,
)
from swarmctl.agent.formation.approaches.place_keeping import on_new_route
from swarmctl.agent.formation.reference import Reference, SpeedProfile, window_for
from swarmctl.agent.formation.shape import Shape, assigned, radius_m

STEP_S = 0.05
MISSION_LOOKS_AHEAD_M = 8.0


@dataclass(frozen=True)
class Autopilot:
    position_hz: float
    velocity_hz: float
    acceleration_m_s2: float
    braking_m_s2: float
    jerk_m_s3: float
    lag_s: float
    speed_m_s: float
    target_moves: bool
    set_point_period_s: float = 0.1

    def toward(self, away: float, gain: float, limit: float) -> float:
        """Return gain times the distance, and for a large one the root whose slope in time is `limit`."""
        linear = limit / gain**2
        return gain * away if away <= linear else math.sqrt(2 * limit * (away - linear / 2))


PX4 = Autopilot(0.95, 1.8, 9.8, 1e6, 1e6, 0.2, 12.0, False)
PX4_5_HZ = Autopilot(0.95, 1.8, 9.8, 1e6, 1e6, 0.2, 12.0, False, 0.2)
ARDUPILOT = Autopilot(1.0, 2.0, 2.5, 1.25, 5.0, 0.0, 50.0, True)
ARDUPILOT_5_HZ = Autopilot(1.0, 2.0, 2.5, 1.25, 5.0, 0.0, 50.0, True, 0.2)


class Vehicle:
    """A point mass with the position control of an autopilot."""

    def __init__(self, autopilot: Autopilot, position: Sequence[float]) -> None:
        self.autopilot = autopilot
        self.position = [*position]
        self.velocity = [0.0, 0.0, 0.0]
        self.acceleration = [0.0, 0.0]
        self.target: list[float] | None = None
        self.feed = [0.0, 0.0, 0.0]

    def set_point(self, velocity: Sequence[float], position: Sequence[float] | None) -> None:
        self.feed, self.target = [*velocity], None if position is None else [*position]

    def step(self, dt: float) -> None:
        pilot = self.autopilot
        wanted = [self.feed[0], self.feed[1]]
        if self.target is not None:
            error = [self.target[k] - self.position[k] for k in (0, 1)]
            away = math.hypot(*error)
            speed = min(pilot.toward(away, pilot.position_hz, pilot.braking_m_s2), pilot.speed_m_s)
            if away > 1e-9:
                wanted = [wanted[k] + speed * error[k] / away for k in (0, 1)]
            climb = max(min(self.target[2] - self.position[2], 1.0), -1.0)
            self.velocity[2] = max(min(self.feed[2] + climb, 3.0), -1.5)
            if pilot.target_moves:
                self.target = [self.target[k] + dt * self.feed[k] for k in range(3)]
        else:
            self.velocity[2] = self.feed[2]
        size = math.hypot(*wanted)
        if size > pilot.speed_m_s:
            wanted = [w * pilot.speed_m_s / size for w in wanted]
        self._accelerate(wanted, dt)

    def _accelerate(self, wanted: Sequence[float], dt: float) -> None:
        pilot = self.autopilot
        error = [wanted[k] - self.velocity[k] for k in (0, 1)]
        size = math.hypot(*error)
        pull = min(pilot.toward(size, pilot.velocity_hz, pilot.jerk_m_s3), pilot.acceleration_m_s2, size / dt)
        aim = [pull * error[k] / size if size > 1e-9 else 0.0 for k in (0, 1)]
        change = [aim[k] - self.acceleration[k] for k in (0, 1)]
        size = math.hypot(*change)
        share = min(dt / max(pilot.lag_s, dt), pilot.jerk_m_s3 * dt / max(size, 1e-9))
        for k in (0, 1):
            self.acceleration[k] += share * change[k]
            self.velocity[k] += dt * self.acceleration[k]
        for k in range(3):
            self.position[k] += dt * self.velocity[k]

    def fly_mission(self, reference: Reference, s_m: float, speed_m_s: float, dt: float) -> None:
        """Fly toward a point ahead on the legs of the route."""
        pilot = self.autopilot
        # The legs themselves: the vehicle knows nothing of the smooth curve.
        aim = reference.legs.point_at(min(s_m + MISSION_LOOKS_AHEAD_M, reference.length_m))
        away = [aim[k] - self.position[k] for k in (0, 1)]
        size = max(math.hypot(*away), 1e-6)
        rest_m = reference.length_m - s_m
        speed = min(speed_m_s, math.sqrt(2 * 1.5 * max(rest_m, 0.0)))
        wanted = [speed * away[k] / size for k in (0, 1)]
        error = [wanted[k] - self.velocity[k] for k in (0, 1)]
        aim_a = [1.8 * e for e in error]
        size = math.hypot(*aim_a)
        limit = min(pilot.acceleration_m_s2, 4.0)
        if size > limit:
            aim_a = [a * limit / size for a in aim_a]
        change = [aim_a[k] - self.acceleration[k] for k in (0, 1)]
        size = math.hypot(*change)
        share = min(1.0, 10.0 * dt / max(size, 1e-9))
        for k in (0, 1):
            self.acceleration[k] += share * change[k]
            self.velocity[k] += dt * self.acceleration[k]
            self.position[k] += dt * self.velocity[k]


@dataclass
class Message:
    at_s: float
    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    place: tuple[float, float, float]
    error_m: float
    along: Along


@dataclass
class Pilot:
    """One member with what it has heard."""

    vehicle: Vehicle
    memory: PlaceMemory | None = None
    inbox: dict[int, Message] = field(default_factory=dict)
    command: ApproachResult | None = None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mission_speed_m_s: float = 0.0
    fails_at_s: float = math.inf


@dataclass
class Sample:
    now_s: float
    positions: list[tuple[float, float, float]]
    errors: list[tuple[float, float, float]]
    s_m: float
    leads: list[int]
    velocities: list[tuple[float, float, float]]


@dataclass
class FormationFlight:
    """A flight of a group; `run` returns its samples."""

    approach: str
    shape: Shape
    points: Sequence[tuple[float, float]]
    n: int
    autopilot: Autopilot = PX4
    cruise_m_s: float = 10.0
    max_speed_m_s: float = 12.0
    delay_s: float = 0.1
    loss: float = 0.0
    seed: int = 1
    separation_m: float = 10.0
    closes_up: bool = True
    lost_after_s: float = 2.5
    outages: Sequence[tuple[float, float]] = ()
    failures: dict[int, float] = field(default_factory=dict)
    params: dict[str, Any] = field(default_factory=dict)
    shapes: Sequence[tuple[float, Shape]] = ()
    routes: Sequence[tuple[float, Sequence[tuple[float, float]]]] = ()
    threats: ThreatField | None = None
    starts: Sequence[tuple[float, float]] | None = None

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)
        self._mail: list[tuple[float, int, int, Message]] = []
        self._module = APPROACHES[self.approach]
        self._params = self._module.Params(**self.params)
        self._limits = MemberLimits(
            speed_m_s=self.max_speed_m_s,
            separation_m=self.separation_m,
            separation_up_m=5.0,
        )
        self._use(self.points)
        pose = self._reference.at(0.0)
        places = self.shape.places(self.n)
        at = self.starts or [pose.at(f, r) for f, r, _ in places]
        self.pilots = [
            Pilot(Vehicle(self.autopilot, (*at[k], 50.0 + places[k][2])), place=places[k])
            for k in range(self.n)
        ]
        for k, at_s in self.failures.items():
            self.pilots[k].fails_at_s = at_s

    def _use(self, points: Sequence[tuple[float, float]]) -> None:
        shapes = (self.shape, *(shape for _, shape in self.shapes))
        radius = max(radius_m(shape.places(self.n)) for shape in shapes)
        self._reference = Reference(tuple(points), window_for(radius))
        self._profile = SpeedProfile.of(
            self._reference, radius, self.cruise_m_s, self.max_speed_m_s, ACCELERATION_M_S2
        )

    def run(self, seconds: float) -> list[Sample]:
        samples = []
        shapes, routes = list(self.shapes), list(self.routes)
        period = round(self.autopilot.set_point_period_s / STEP_S)
        for step in range(round(seconds / STEP_S)):
            now = step * STEP_S
            if shapes and now >= shapes[0][0]:
                self.shape = shapes.pop(0)[1]
            if routes and now >= routes[0][0]:
                self._change_route(routes.pop(0)[1])
            self._deliver(now)
            for k, pilot in enumerate(self.pilots):
                if now >= pilot.fails_at_s:
                    pilot.vehicle.set_point((0.0, 0.0, -1.0), None)
                elif (step + k) % period == 0:
                    self._decide(k, now)
            if step % 2 == 0:
                self._tell(now)
            for pilot in self.pilots:
                if pilot.command is not None and pilot.command.demand is None and now < pilot.fails_at_s:
                    pilot.vehicle.fly_mission(
                        self._reference, pilot.command.memory.along.s_m, pilot.mission_speed_m_s, STEP_S
                    )
                    pilot.vehicle.position[2] += STEP_S * pilot.vehicle.velocity[2]
                    pilot.vehicle.velocity[2] = max(
                        min(50.0 + pilot.place[2] - pilot.vehicle.position[2], 1.0), -1.0
                    )
                else:
                    pilot.vehicle.step(STEP_S)
            samples.append(self._sample(now + STEP_S))
        return samples

    def _change_route(self, points: Sequence[tuple[float, float]]) -> None:
        before = self._reference
        self._use(points)

        def moved(message: Message) -> Message:
            return replace(message, along=on_new_route(message.along, before, self._reference))

        for pilot in self.pilots:
            if (memory := pilot.memory) is not None:
                along = on_new_route(memory.along, before, self._reference)
                pilot.memory = replace(memory, along=along)
            pilot.inbox = {k: moved(message) for k, message in pilot.inbox.items()}
        self._mail = [(at_s, j, k, moved(message)) for at_s, j, k, message in self._mail]

    def _present(self, k: int, now: float) -> list[bool]:
        inbox = self.pilots[k].inbox
        return [j == k or (j in inbox and now - inbox[j].at_s <= self.lost_after_s) for j in range(self.n)]

    def _decide(self, k: int, now: float) -> None:
        pilot = self.pilots[k]
        present = self._present(k, now)
        if now < 0.3:  # all are there from the beginning
            present = [True] * self.n
        numbers = assigned(present, closes_up=self.closes_up)
        places = self.shape.places(self.n)
        number = numbers[k]
        assert number is not None
        pilot.place = places[number]
        leader = present.index(True)
        others, of_leader = [], None
        for j, message in sorted(pilot.inbox.items()):
            if not present[j]:
                continue
            if j == leader:
                of_leader = len(others)
            others.append(
                OtherMember(
                    message.position,
                    message.velocity,
                    now - message.at_s,
                    places[numbers[j] or 0],
                    message.error_m,
                )
            )
        if leader == k:
            told = None if pilot.memory is None else (pilot.memory.along, pilot.memory.now_s)
        elif leader in pilot.inbox:
            message = pilot.inbox[leader]
            told = message.along, message.at_s
        else:
            return
        along = None if told is None else Along(told[0].s_m, told[0].speed_m_s, now - told[1])
        lead_s = 0.0 if self.autopilot.target_moves else 0.5 * self.autopilot.set_point_period_s
        group = Group(
            now_s=now,
            position_m=tuple(pilot.vehicle.position),
            velocity_m_s=tuple(pilot.vehicle.velocity),
            place=pilot.place,
            others=tuple(others),
            along=along,
            reference=self._reference,
            profile=self._profile,
            height_m=50.0,
            limits=self._limits,
            leader=None if leader == k else of_leader,
            flies_mission=leader == k and (pilot.command is None or pilot.command.demand is None),
            memory=pilot.memory,
            threats=self.threats,
            lead_s=lead_s,
        )
        command = self._module.fly(self._params, group)
        pilot.command, pilot.memory = command, command.memory
        if command.demand is not None:
            pilot.vehicle.set_point(command.demand.velocity_m_s, command.demand.position_m)
        pilot.mission_speed_m_s = command.mission_speed_m_s or 0.0

    def _tell(self, now: float) -> None:
        for k, pilot in enumerate(self.pilots):
            if now >= pilot.fails_at_s or pilot.command is None:
                continue
            e, c = pilot.command.error_m, pilot.command
            along, age_s = c.memory.along, now - c.memory.now_s
            s_m, v = self._profile.ahead(along.s_m, along.speed_m_s, age_s)
            message = Message(
                now,
                tuple(pilot.vehicle.position),
                tuple(pilot.vehicle.velocity),
                pilot.place,
                math.hypot(e[0], e[1]),
                Along(s_m, v),
            )
            for j in range(self.n):
                if j == k or self._random.random() < self.loss:
                    continue
                if any(a <= now < b for a, b in self.outages):
                    continue
                self._mail.append((now + self.delay_s, j, k, message))

    def _deliver(self, now: float) -> None:
        due = [mail for mail in self._mail if mail[0] <= now + 1e-9]
        self._mail = [mail for mail in self._mail if mail[0] > now + 1e-9]
        for _, j, k, message in due:
            self.pilots[j].inbox[k] = message

    def _sample(self, now: float) -> Sample:
        """Errors are of each vehicle against the place that the true reference point gives now."""
        alive = [p for p in self.pilots if now < p.fails_at_s]
        leads = [k for k, p in enumerate(self.pilots) if p.command is not None and p in alive]
        first = alive[0]
        errors = []
        if (memory := first.memory) is None:
            return Sample(now, [], [], 0.0, [], [])
        s_m, _ = self._profile.ahead(memory.along.s_m, memory.along.speed_m_s, now - memory.now_s)
        pose = self._reference.at(s_m)
        point = (pose.east_m, pose.north_m)
        if self._module.LEADER_FLIES_MISSION:
            at = pose.at(*first.place[:2])
            point = tuple(first.vehicle.position[k] - at[k] + point[k] for k in (0, 1))
        elif self.approach == "behavioural":
            refs = []
            for p in alive:
                at = pose.at(*p.place[:2])
                refs.append([p.vehicle.position[k] - at[k] + point[k] for k in (0, 1)])
            point = tuple(sum(r[k] for r in refs) / len(refs) for k in (0, 1))
        sin, cos = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
        for p in self.pilots:
            at = pose.at(*p.place[:2])
            e = p.vehicle.position[0] - (point[0] + at[0] - pose.east_m)
            n = p.vehicle.position[1] - (point[1] + at[1] - pose.north_m)
            errors.append((e * sin + n * cos, e * cos - n * sin, p.vehicle.position[2] - 50.0 - p.place[2]))
        return Sample(
            now,
            [tuple(p.vehicle.position) for p in self.pilots],
            errors,
            s_m,
            leads,
            [tuple(p.vehicle.velocity) for p in self.pilots],
        )


def least_distance_m(samples: Sequence[Sample], members: Sequence[int]) -> float:
    """Return the least horizontal distance between members within 5 m in height."""
    least = math.inf
    for sample in samples:
        for a, i in enumerate(members):
            for j in members[a + 1 :]:
                p, q = sample.positions[i], sample.positions[j]
                if abs(p[2] - q[2]) < 5.0:
                    least = min(least, math.dist(p[:2], q[:2]))
    return least


def rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values))

"""A vehicle whose answers, telemetry and mishaps are drawn; it drives a procedure without a wire.

Each conversation of the procedure ends with a drawn result. Commands usually take effect. At any time a pilot
may take over, the position may be lost, or the vehicle may land.
"""

from __future__ import annotations

from random import Random
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LocalFrame
from swarmctl.core.mission import Approach, FlightPlan, Waypoint
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.dialects.ardupilot import ArduCopter
from swarmctl.mavlink.dialects.arduplane import ArduPlane
from swarmctl.mavlink.dialects.px4 import Px4Copter
from swarmctl.mavlink.dialects.px4plane import Px4Plane
from swarmctl.mavlink.protocol.command import CommandOutcome, CommandResult
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.mission_append import Append, AppendResult
from swarmctl.mavlink.protocol.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.protocol.mission_upload import Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import RequestUntil, WaitUntil

FRAME = LocalFrame(47.0, 8.0)
START = FRAME.to_geodetic(0.0, 0.0)
OLD = ((0.0, 0.0), (0.0, 200.0), (150.0, 200.0), (150.0, 600.0))
DIALECTS = (ArduCopter(), Px4Copter(), ArduCopter(), Px4Copter(), ArduPlane(), Px4Plane())
SPEED_M_S = 8.0
OTHER_MESSAGE = mavlink.MAVLink_statustext_message(6, b"", 0, 0)
"""a message that no conversation waits for, after which each looks again"""
SHARES = (0.0, 0.02, 0.1, 0.3)
"""shares of mishaps and of failures, of which each vehicle draws one"""


def drawn_swap(seed: int) -> tuple[DrawnVehicle, FlightPlan]:
    """Return a vehicle on its way over `OLD`, and a plan that replaces the old one."""
    draw = Random(seed)
    vehicle = DrawnVehicle(draw, draw.choice(DIALECTS))
    east_m, north_m = vehicle.place()
    new = draw.choice(
        [
            ((0.0, 200.0), (150.0, 200.0), (400.0, 200.0)),
            ((0.0, draw.uniform(50.0, 400.0)), (-200.0, 400.0)),
            ((east_m + 100.0, north_m + 50.0), (300.0, 300.0)),
            ((150.0, 200.0), (150.0, 300.0), (300.0, 300.0)),
            ((0.0, 200.0), (-100.0, 200.0), (-100.0, 500.0)),
        ]
    )
    leaves_ahead, from_hold = draw.random() < 0.6, draw.random() < 0.2
    return vehicle, replace(vehicle.plan(*new), leaves_ahead=leaves_ahead, from_hold=from_hold)


class DrawnVehicle:
    """A flying vehicle, and the telemetry that a `Context` reads."""

    def __init__(self, draw: Random, dialect: Dialect) -> None:
        self.draw, self.dialect = draw, dialect
        self.context = Context(MavlinkPeer(1), 0, dialect, self)  # type: ignore[arg-type]
        self.stored = dialect.mission_items(self.plan(*OLD), START)
        self.track, self.at_m = list(OLD), draw.uniform(0.0, 350.0)
        self.mishaps, self.failures = draw.choice(SHARES) / 4.0, draw.choice(SHARES)
        self.texts: list[tuple[int, str]] = []
        self.n_texts = self.n_heartbeats = 0
        self.stood_still_s = self.position_age_s = 0.0
        self.is_silent = False
        self.state = VehicleState(
            time_boot_s=100.0,
            alt_rel_m=20.0,
            alt_amsl_m=320.0,
            mode=dialect.mission_mode if draw.random() < 0.9 else dialect.hold_mode,
            armed=True,
            landed=Landed.IN_AIR,
            home_lat_deg=START[0],
            home_lon_deg=START[1],
            mission_seq=dialect.first_waypoint_seq + draw.choice((0, 0, 0, 1, 2)),
        )
        self.context.verified_items = self.stored if draw.random() < 0.9 else ()
        self.context.plan_first_seq = dialect.first_waypoint_seq + (draw.random() < 0.1)
        self.fly(0.0)

    def plan(self, *points: PlanarPoint) -> FlightPlan:
        """Return a plan of this kind of vehicle over points (east, north) [m]."""
        track = tuple(Waypoint(*FRAME.to_geodetic(*point), 20.0) for point in points)
        plan = FlightPlan(20.0, track, track[-1])
        if not isinstance(self.dialect, ArduPlane | Px4Plane):
            return plan
        approach = Approach(track[-1], 50.0, track[-1], replace(track[-1], alt_rel_m=0.0))
        return replace(plan, approach=approach, home_approach=approach)

    # telemetry

    def texts_since(self, n_texts: int) -> list[tuple[int, str]]:
        return self.texts[n_texts:]

    @property
    def clock(self) -> DrawnVehicle:
        """Return this object, which knows the age of its telemetry."""
        return self

    def age_s(self, now: float) -> float:
        return 9.0 if self.is_silent else 0.1

    def is_old(self, now: float, limit_s: float) -> bool:
        return self.age_s(now) > limit_s

    # flight

    def fly(self, seconds: float) -> None:
        """Fly on along the track, and draw what else happens in that time."""
        holds = self.state.mode == self.dialect.hold_mode
        speed_m_s = 0.0 if holds else SPEED_M_S
        self.context.now += seconds
        self.at_m += speed_m_s * seconds
        self.stood_still_s += seconds * holds
        self.n_heartbeats += 1
        lat_deg, lon_deg = FRAME.to_geodetic(*self.place())
        self.change(time_boot_s=self.state.time_boot_s + seconds, lat_deg=lat_deg, lon_deg=lon_deg)
        self.change(ground_speed_m_s=speed_m_s, north_m_s=speed_m_s)
        if self.draw.random() < self.mishaps:
            self.have_mishap()

    def change(self, **values: Any) -> None:
        self.state = replace(self.state, **values)

    def place(self) -> PlanarPoint:
        left_m = self.at_m
        for (ax, ay), (bx, by) in zip(self.track, self.track[1:], strict=False):
            leg_m = ((bx - ax) ** 2 + (by - ay) ** 2) ** 0.5
            if left_m < leg_m:
                return ax + (bx - ax) * left_m / leg_m, ay + (by - ay) * left_m / leg_m
            left_m -= leg_m
        return self.track[-1]

    def have_mishap(self) -> None:
        draw = self.draw
        match draw.randrange(12):
            case 0:
                self.is_silent = not self.is_silent
            case 1:  # as PX4 leaves a mission that it cannot fly
                self.texts.append((2, "Mission rejected: no valid mission"))
                self.n_texts += 1
                self.change(mode=self.dialect.hold_mode)
            case 2:
                self.at_m += 60.0
            case 3:
                self.track.insert(0, (500.0, 500.0))
            case 4:
                self.stored = self.stored[: draw.randrange(len(self.stored) + 1)]
            case 5:
                self.position_age_s = draw.uniform(0.0, 3.0)
            case 6:
                self.change(mode=draw.choice(("LOITER", self.dialect.hold_mode)))
            case 7:
                self.change(armed=False)
            case 8:
                self.change(landed=draw.choice(list(Landed)))
            case 9:
                self.change(lat_deg=None, lon_deg=None)
            case 10:
                self.change(alt_rel_m=None)
            case 11:
                self.change(mission_seq=draw.choice((None, 0, 1, 2, 5, 99)))

    # answers

    def perform(self, procedure: Procedure[Any]) -> Any:
        """Drive a procedure to its end; return its result."""
        answer: Any = None
        while True:
            try:
                conversation: Any = procedure.send(answer)
            except StopIteration as stop:
                return stop.value
            match conversation:
                case WaitUntil():
                    answer = self.wait(conversation)
                case Upload():
                    answer = self.upload(conversation)
                case Append():
                    answer = self.append(conversation)
                case Download():
                    answer = self.download(conversation)
                case _:
                    answer = self.command(conversation)

    def usually(self) -> bool:
        return self.draw.random() >= self.failures

    def wait(self, conversation: Any) -> bool:
        now = self.context.now
        messages = conversation.start(now)
        for _ in range(self.draw.randint(1, 4)):
            conversation.receive(OTHER_MESSAGE, now)
            if conversation.result:
                return True
            self.fly(self.draw.choice((0.1, 0.5, 2.0)))
        if isinstance(conversation, RequestUntil):
            conversation.receive(mavlink.MAVLink_message(int(messages[0].param1), ""), now)
        while conversation.result is None:
            conversation.tick(conversation.next_deadline)
        return bool(conversation.result)

    def command(self, conversation: Any) -> CommandResult:
        (message,) = conversation.start(self.context.now)
        self.fly(self.draw.choice((0.05, 0.3, 1.5)))
        if self.usually():
            if message.get_type() == "MISSION_SET_CURRENT":
                self.change(mission_seq=message.seq)
            elif message.command == mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
                self.change(mission_seq=int(message.param1))
            elif message.command == mavlink.MAV_CMD_DO_SET_MODE:
                _, *wanted = self.dialect.mode_params(self.dialect.hold_mode)
                sent = [message.param2, message.param3][: len(wanted)]
                self.change(mode=self.dialect.hold_mode if sent == wanted else self.dialect.mission_mode)
        outcome = CommandOutcome.ACCEPTED if self.usually() else self.draw.choice(list(CommandOutcome))
        return CommandResult(outcome, "the command")

    def upload(self, conversation: Any) -> UploadResult:
        self.fly(self.draw.choice((0.2, 1.0, 4.0)))
        round_trip_s = self.draw.choice((0.1, 0.5, 3.0))
        if conversation.too_late is not None and conversation.too_late(round_trip_s):
            return UploadResult(UploadOutcome.TOO_LATE, "too late")
        outcome = UploadOutcome.ACCEPTED if self.usually() else self.draw.choice(list(UploadOutcome))
        if outcome in (UploadOutcome.ACCEPTED, UploadOutcome.UNCONFIRMED) or not self.usually():
            self.stored = conversation.items
            marked = conversation.current
            if self.usually() and marked is not None and self.dialect.uploads_atomically:
                self.change(mission_seq=marked)
        return UploadResult(outcome, outcome.value)

    def append(self, conversation: Any) -> AppendResult:
        self.fly(self.draw.choice((0.2, 1.0, 4.0)))
        round_trip_s = self.draw.choice((0.1, 0.5, 3.0))
        before = self.stored[: conversation.n_before]
        if conversation.too_late(round_trip_s):
            self.stored = before + conversation.items[: self.draw.randint(0, 2)]
            return AppendResult("too late", round_trip_s, is_late=True)
        if not self.usually():
            return AppendResult("not appended", round_trip_s, is_foreign=self.draw.random() < 0.5)
        self.stored = before + conversation.items
        return AppendResult(None, round_trip_s)

    def download(self, conversation: Any) -> DownloadResult:
        self.fly(self.draw.choice((0.1, 0.5, 2.0)))
        outcome = DownloadOutcome.COMPLETE if self.usually() else self.draw.choice(list(DownloadOutcome))
        found = self.stored[conversation.first :] if outcome is DownloadOutcome.COMPLETE else ()
        return DownloadResult(outcome, found, outcome.value)

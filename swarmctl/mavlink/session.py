"""Session of one vehicle without I/O: presence, telemetry, streams, and one procedure at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.events import LinkLost, LinkRestored, Rebooted, TelemetryReceived
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.setpoint import SetPoint
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.dialects import Dialect, Unsupported, dialect_for
from swarmctl.mavlink.events import FirstHeartbeat, Identity, ProcedureDone, SessionEvent, StatusText
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import IllegalEvent, MavlinkPeer
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Driver, Procedure
from swarmctl.mavlink.protocol.setpoint import setpoint_message
from swarmctl.mavlink.telemetry.mission_watch import MissionWatch
from swarmctl.mavlink.telemetry.presence import LinkState, Presence, is_vehicle_heartbeat
from swarmctl.mavlink.telemetry.streams import AFTER_SILENCE_S, UNUSED_IDS, Streaming, StreamKeeper
from swarmctl.mavlink.telemetry.vehicle_state import Telemetry

READ_IDS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
        mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
        mavlink.MAVLINK_MSG_ID_TIMESYNC,
        mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_MISSION_ACK,
        mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
        mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
    }
)
"""ids of the messages that a session reads; other messages need no decoding"""


class SessionStep(NamedTuple):
    """Messages to send and events to report after one input."""

    messages: list[Message]
    events: list[SessionEvent]


@dataclass(slots=True)
class _Vehicle:
    """A supported vehicle, known from its first heartbeat on."""

    heartbeat: FirstHeartbeat
    """autopilot and type in the last heartbeat"""
    context: Context
    streams: StreamKeeper
    mission: MissionWatch


class Session:
    """Session of one vehicle. Every input returns the messages to send and the events to report."""

    def __init__(self, peer: MavlinkPeer, streaming: Streaming | None = None) -> None:
        self.peer = peer
        self.unsupported: str | None = None
        """reason why this type of vehicle is unsupported, set by the first heartbeat; None if supported"""
        self._presence = Presence()
        self._streaming = streaming or Streaming()
        self._vehicle: _Vehicle | None = None
        """None before the first heartbeat, and if the vehicle is unsupported"""
        self._other_mission = False
        """True if another station has uploaded a mission"""
        self._driver: Driver[Any] | None = None
        self._procedure_name = ""

    # State

    @property
    def read_ids(self) -> frozenset[int]:
        """Return the ids of the messages that the session reads."""
        return READ_IDS | UNUSED_IDS if self._streaming.stops_others else READ_IDS

    @property
    def state(self) -> VehicleState:
        return VehicleState() if self._vehicle is None else self._vehicle.context.state

    @property
    def items(self) -> tuple[MissionItem, ...]:
        return () if self._vehicle is None else self._vehicle.context.verified_items

    @property
    def busy_with(self) -> str | None:
        return self._procedure_name if self._driver is not None else None

    @property
    def may_change_address(self) -> bool:
        """Return whether the vehicle is lost or never heard, and no command or transfer is under way."""
        is_alive = self._presence.state is LinkState.ALIVE
        return not is_alive and (self._driver is None or self._driver.is_waiting)

    @property
    def dialect(self) -> Dialect:
        """Return the vehicle's dialect. Raises IllegalEvent for an unknown or unsupported vehicle."""
        return self._known_vehicle().context.dialect

    def mission_items(self, plan: FlightPlan) -> tuple[MissionItem, ...]:
        """Return a plan as this vehicle's mission. Raises ValueError for a plan that cannot be flown."""
        return self.dialect.mission_items(plan, self.state.takeoff_lat_lon)

    def setpoint_message(self, setpoint: SetPoint, now: float) -> Message | None:
        """Return the message that sends a set-point now; None if this vehicle does not follow set-points.

        Raises ValueError for a set-point that is incomplete or not finite.
        """
        if self._vehicle is None or self.dialect.setpoint_mode is None:
            return None
        self._vehicle.context.setpoint_sent_s = now
        return setpoint_message(self.peer, setpoint)

    def age_s(self, now: float) -> float:
        return self._presence.age_s(now)

    def identity(self, version: Message) -> Identity:
        """Return the vehicle's identity from its heartbeat and an AUTOPILOT_VERSION."""
        heartbeat = self._known_vehicle().heartbeat
        number = int(version.flight_sw_version)
        firmware = f"{self.dialect.name} {number >> 24}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF}"
        uid2 = bytes(version.uid2)
        return Identity(self.peer.sysid, heartbeat.autopilot, heartbeat.vehicle_type, firmware, uid2)

    @property
    def next_deadline(self) -> float | None:
        vehicle = self._vehicle
        if vehicle is None:
            return self._presence.next_deadline
        sources = (self._presence, vehicle.streams, self._driver or vehicle.mission)
        deadlines = [due for source in sources if (due := source.next_deadline) is not None]
        return min(deadlines, default=None)

    # Inputs

    def receive(self, message: Message, now: float) -> SessionStep:
        step = SessionStep([], [])
        if (message.get_srcSystem(), message.get_srcComponent()) != (self.peer.sysid, self.peer.compid):
            return step
        is_heartbeat = message.get_type() == "HEARTBEAT"
        if is_heartbeat and not is_vehicle_heartbeat(message):
            return step  # from a companion with the autopilot's component id
        is_restored = is_heartbeat and self._on_heartbeat(message, now, step)
        if self._vehicle is None:
            return step
        is_new_state = self._update_telemetry(self._vehicle, message, now, step)
        if is_new_state or is_restored:
            # After a loss the agent uses this state, so it includes the heartbeat.
            step.events.append(TelemetryReceived(self.state))
        if self._driver is not None:
            step.messages.extend(self._driver.receive(message, now))
            self._report_end(step, now)
        return step

    def tick(self, now: float) -> SessionStep:
        step = SessionStep([], [])
        if self._presence.tick(now):
            step.events.append(LinkLost(self._presence.age_s(now)))
        if self._vehicle is None:
            return step
        step.messages.extend(self._vehicle.streams.tick(now))
        if self._driver is not None:
            step.messages.extend(self._driver.tick(now))
            self._report_end(step, now)
        else:
            step.messages.extend(self._vehicle.mission.tick(self.state.mission_seq, now))
        return step

    def begin(self, name: str, procedure: Callable[[Context], Procedure[Any]], now: float) -> SessionStep:
        """Start a procedure. Raises IllegalEvent during another procedure, and as `dialect` does."""
        if self._driver is not None:
            raise IllegalEvent(f"{name} while {self._procedure_name} runs")
        context = self._known_vehicle().context
        self._procedure_name = name
        self._driver = Driver(procedure(context), context)
        step = SessionStep(self._driver.start(now), [])
        self._report_end(step, now)
        return step

    def cancel(self, now: float) -> SessionStep:
        """Stop the running procedure, if any; return the messages that end its exchange on the vehicle."""
        step = SessionStep([], [])
        if self._driver is not None:
            step.messages.extend(self._driver.cancel(now))
            step.events.append(self._end(Done("cancelled"), now, interrupted=True))
        return step

    def keep_streams(self, now: float) -> SessionStep:
        """Request the telemetry streams, and request a stream again when the stream stops."""
        streams = self._known_vehicle().streams
        if streams.next_deadline is None:
            streams.demand(now)
        return SessionStep(streams.tick(now), [])

    def _on_heartbeat(self, message: Message, now: float, step: SessionStep) -> bool:
        """Record a heartbeat; return whether the vehicle was lost before it."""
        before = self._presence.on_heartbeat(now)
        heartbeat = FirstHeartbeat(int(message.autopilot), int(message.type))
        if before is LinkState.NEVER_HEARD:
            step.events.append(heartbeat)
            self._identify(heartbeat)
        was_lost = before is LinkState.LOST
        if was_lost:
            step.events.append(LinkRestored())
        if self._vehicle is not None:
            self._vehicle.heartbeat = heartbeat
            if was_lost:
                self._vehicle.streams.renew(now + AFTER_SILENCE_S)
        return was_lost

    def _identify(self, heartbeat: FirstHeartbeat) -> None:
        try:
            dialect = dialect_for(heartbeat.autopilot, heartbeat.vehicle_type)
        except Unsupported as error:
            self.unsupported = str(error)
            return
        rates_hz = self._streaming.rates_hz(dialect.streams_hz)
        self._vehicle = _Vehicle(
            heartbeat,
            Context(self.peer, heartbeat.autopilot, dialect, Telemetry(dialect)),
            StreamKeeper(self.peer, rates_hz, stops_others=self._streaming.stops_others),
            MissionWatch(self.peer, dialect),
        )

    def _update_telemetry(self, vehicle: _Vehicle, message: Message, now: float, step: SessionStep) -> bool:
        """Update telemetry, mission watch and streams; return whether the vehicle's state is new."""
        context, telemetry = vehicle.context, vehicle.context.telemetry
        n_texts, n_reboots = telemetry.n_texts, telemetry.n_reboots
        context.now = now
        is_new_state = telemetry.receive(message, now) | self._watch_mission(vehicle, message, now)
        if telemetry.n_texts != n_texts:
            step.events.extend(StatusText(*text) for text in telemetry.texts_since(n_texts))
        if telemetry.n_reboots != n_reboots:
            step.events.append(Rebooted())
            context.verified_items, self._other_mission = (), False
            vehicle.mission.own_procedure_ended((), now)
            vehicle.streams.renew(now)
            step.messages.extend(vehicle.streams.tick(now))
        step.messages.extend(telemetry.clock.questions(now))
        vehicle.streams.on_message(message.get_msgId(), now)
        if is_new_state:
            step.messages.extend(vehicle.streams.set_armed(telemetry.state.armed, now))
        return is_new_state

    def _watch_mission(self, vehicle: _Vehicle, message: Message, now: float) -> bool:
        """Update `other_mission` of the vehicle's state; return whether `other_mission` has changed."""
        context, mission = vehicle.context, vehicle.mission
        if context.verified_items and self._other_mission:
            return self._report_other_mission(context, False)
        if self._driver is not None:
            mission.receive_own_transfer(message)
            return False
        if not mission.shows_other_mission(message, now):
            return False
        context.verified_items = ()
        mission.own_procedure_ended((), now)
        return self._report_other_mission(context, True)

    def _report_other_mission(self, context: Context, is_stored: bool) -> bool:
        self._other_mission = is_stored
        context.telemetry.set_other_mission(is_stored)
        return True

    def _report_end(self, step: SessionStep, now: float) -> None:
        if self._driver is not None and self._driver.result is not None:
            step.events.append(self._end(self._driver.result, now, interrupted=False))

    def _end(self, result: Any, now: float, *, interrupted: bool) -> ProcedureDone:
        """End the running procedure."""
        vehicle = self._known_vehicle()
        self._driver, vehicle.context.interrupted = None, interrupted
        vehicle.mission.own_procedure_ended(vehicle.context.verified_items, now)
        return ProcedureDone(self._procedure_name, result)

    def _known_vehicle(self) -> _Vehicle:
        if self._vehicle is None:
            raise IllegalEvent(f"system {self.peer.sysid} is unknown: no usable heartbeat received yet")
        return self._vehicle

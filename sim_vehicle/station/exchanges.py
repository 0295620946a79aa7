"""Requests of a ground station to one vehicle, as state machines without I/O."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.params import as_float32

RESEND_S = 1.5
STALLED_S = 12.0  # time without progress after which an upload restarts
COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1

Send = Callable[[Any], None]


@dataclass(frozen=True, slots=True)
class ExchangeOutcome:
    """The outcome of an exchange; `text` is the answer in words."""

    accepted: bool
    text: str


class Exchange:
    """A request that is repeated until its answer; `outcome` is None before the answer."""

    def __init__(self, sysid: int, send: Send) -> None:
        self.sysid, self._send = sysid, send
        self.outcome: ExchangeOutcome | None = None
        self._sent_s = 0.0

    def begin(self, now: float) -> None:
        self.outcome = None
        self._transmit(now)

    def _transmit(self, now: float) -> None:
        self._sent_s = now
        self._send(self.message())

    def message(self) -> Any:
        raise NotImplementedError

    def receive(self, message: Any, now: float) -> None:
        """Process any message of the vehicle."""

    def tick(self, now: float) -> None:
        if self.outcome is None and now - self._sent_s >= RESEND_S:
            self._transmit(now)


class LongCommand(Exchange):
    """COMMAND_LONG, repeated until the acknowledgement."""

    def __init__(self, sysid: int, send: Send, command: int, params: Sequence[float] = ()) -> None:
        super().__init__(sysid, send)
        self.command = command
        self._params = [*params, *[0.0] * (7 - len(params))]
        self._confirmation = 0

    def begin(self, now: float) -> None:
        self._confirmation = 0
        super().begin(now)

    def message(self) -> Any:
        confirmation = self._confirmation
        self._confirmation = min(confirmation + 1, 255)
        return mavlink.MAVLink_command_long_message(
            self.sysid, COMPONENT, self.command, confirmation, *self._params
        )

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() != "COMMAND_ACK" or message.command != self.command:
            return
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            self._sent_s = now
        else:
            name = mavlink.enums["MAV_RESULT"][message.result].name.removeprefix("MAV_RESULT_")
            self.outcome = ExchangeOutcome(message.result == mavlink.MAV_RESULT_ACCEPTED, name)


class WaitUntilReady(Exchange):
    """A wait of at most `give_up_s` for the pre-arm bit in SYS_STATUS.

    After this time the exchange succeeds too, because the refusal of the next arming gives the reason. If the
    autopilot has no such bit, the wait ends with the first SYS_STATUS.
    """

    def __init__(self, sysid: int, send: Send, give_up_s: float) -> None:
        super().__init__(sysid, send)
        self._give_up_s = give_up_s
        self._end_s: float | None = None

    def begin(self, now: float) -> None:
        self._end_s = now + self._give_up_s
        super().begin(now)

    def message(self) -> Any:
        message_id = float(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
        request = mavlink.MAV_CMD_REQUEST_MESSAGE
        return mavlink.MAVLink_command_long_message(
            self.sysid, COMPONENT, request, 0, message_id, 0, 0, 0, 0, 0, 0
        )

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() != "SYS_STATUS":
            return
        self._sent_s = now  # delays the next request of the streamed message
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        if message.onboard_control_sensors_health & bit or not message.onboard_control_sensors_present & bit:
            self.outcome = ExchangeOutcome(True, "ready")

    def tick(self, now: float) -> None:
        super().tick(now)
        if self.outcome is None and self._end_s is not None and now >= self._end_s:
            self.outcome = ExchangeOutcome(True, "not ready")


class Reposition(LongCommand):
    """DO_REPOSITION as COMMAND_INT, with a mode change."""

    def __init__(self, sysid: int, send: Send, frame: int, x: int, y: int, z: float) -> None:
        super().__init__(sysid, send, mavlink.MAV_CMD_DO_REPOSITION)
        self._frame, self._target = frame, (x, y, z)

    def message(self) -> Any:
        flags = float(mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)
        params = (-1.0, flags, 0.0, float("nan"))
        return mavlink.MAVLink_command_int_message(
            self.sysid, COMPONENT, self._frame, self.command, 0, 0, *params, *self._target
        )


class ChangeMode(LongCommand):
    """DO_SET_MODE, repeated until a refusal or a heartbeat in the mode; an autopilot may undo the change."""

    def __init__(self, sysid: int, send: Send, number: int, params: Sequence[float]) -> None:
        super().__init__(sysid, send, mavlink.MAV_CMD_DO_SET_MODE, params)
        self._number = number

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() == "HEARTBEAT" and message.custom_mode == self._number:
            self.outcome = ExchangeOutcome(True, "ACCEPTED")
            return
        super().receive(message, now)
        if self.outcome is not None and self.outcome.accepted:
            self.outcome, self._sent_s = None, now + RESEND_S  # longer wait for the heartbeat


class SetParameter(Exchange):
    """A read of a parameter for its type, then PARAM_SET until the vehicle answers with the value."""

    def __init__(self, sysid: int, send: Send, name: str, value: float, *, byte_wise: bool) -> None:
        super().__init__(sysid, send)
        self._name, self._value, self._byte_wise = name, value, byte_wise
        self._type: int | None = None

    def message(self) -> Any:
        name = self._name.encode()
        if self._type is None:
            return mavlink.MAVLink_param_request_read_message(self.sysid, COMPONENT, name, -1)
        return mavlink.MAVLink_param_set_message(self.sysid, COMPONENT, name, self._wire(), self._type)

    def _wire(self) -> float:
        if self._byte_wise and self._type != mavlink.MAV_PARAM_TYPE_REAL32:
            (as_float,) = struct.unpack("<f", struct.pack("<i", round(self._value)))
            return float(as_float)
        return as_float32(self._value)

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() != "PARAM_VALUE" or message.param_id != self._name:
            return
        if self._type is None:
            self._type = message.param_type
            self._transmit(now)
        else:
            same = repr(as_float32(message.param_value)) == repr(self._wire())
            self.outcome = ExchangeOutcome(
                same, "ACCEPTED" if same else f"{self._name} is {message.param_value:g}"
            )


class UploadPlan(Exchange):
    """The upload of a mission or fence, restarted after `STALLED_S` without a request."""

    def __init__(self, sysid: int, send: Send, items: Sequence[Item], mission_type: int) -> None:
        super().__init__(sysid, send)
        self._items, self._type = items, mission_type
        self._requested = False

    def begin(self, now: float) -> None:
        self._requested = False
        super().begin(now)

    def message(self) -> Any:
        return mavlink.MAVLink_mission_count_message(self.sysid, COMPONENT, len(self._items), self._type)

    def receive(self, message: Any, now: float) -> None:
        kind = message.get_type()
        if getattr(message, "mission_type", None) != self._type or self.outcome is not None:
            return
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(self._items):
            self._requested, self._sent_s = True, now
            self._send(self._item(message.seq))
        elif kind == "MISSION_ACK" and message.type != mavlink.MAV_MISSION_INVALID_SEQUENCE:
            # INVALID_SEQUENCE answers one repeated item; the upload continues.
            name = mavlink.enums["MAV_MISSION_RESULT"][message.type].name.removeprefix("MAV_MISSION_")
            self.outcome = ExchangeOutcome(message.type == mavlink.MAV_MISSION_ACCEPTED, name)

    def tick(self, now: float) -> None:
        if self._requested and now - self._sent_s >= STALLED_S:
            self._requested = False
        if not self._requested:
            super().tick(now)

    def _item(self, seq: int) -> Any:
        item = self._items[seq]
        params = (item.param1, item.param2, item.param3, item.param4)
        return mavlink.MAVLink_mission_item_int_message(
            self.sysid, COMPONENT, seq, item.frame, item.command, 0, 1, *params,
            item.x, item.y, item.z, self._type,
        )  # fmt: skip

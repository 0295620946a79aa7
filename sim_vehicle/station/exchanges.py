"""Requests of a ground station to one vehicle, as state machines without I/O."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.station.frames import STATION
from sim_vehicle.station.messages import MISSION, PlanItem, Target, command_long, enum_name, set_mode, to_wire

RESEND_S = 1.5
IN_PROGRESS_S = 60.0  # longest wait for the next COMMAND_ACK after IN_PROGRESS
REQUESTS = ("MISSION_REQUEST", "MISSION_REQUEST_INT")
STALLED_S = 12.0  # time without a request after which an upload restarts or ends

Send = Callable[[Any], object]


@dataclass(frozen=True, slots=True)
class ExchangeOutcome:
    """The outcome of an exchange; `text` is the answer in words."""

    accepted: bool
    text: str
    message: Any = None  # the vehicle's answer; None if there is none


class Exchange:
    """A request that is repeated until its answer; `outcome` is None before the answer.

    is_answer: True for the message that ends the exchange.
    attempts: number of transmissions without an answer after which the exchange ends; None: no limit.
    """

    def __init__(
        self,
        send: Send,
        request: Any = None,
        *,
        is_answer: Callable[[Any], bool] = lambda _: False,
        resend_s: float = RESEND_S,
        attempts: int | None = None,
    ) -> None:
        self._send, self._request, self._is_answer = send, request, is_answer
        self._resend_s, self._attempts = resend_s, attempts
        self.outcome: ExchangeOutcome | None = None
        self.due_s = 0.0  # time of the next repetition
        self._n_sent = 0

    def begin(self, now: float) -> None:
        self.outcome, self._n_sent = None, 0
        self._transmit(now)

    def _transmit(self, now: float) -> None:
        self.due_s = now + self._resend_s
        self._send(self.message())
        self._n_sent += 1

    def message(self) -> Any:
        """Return the request of the next transmission."""
        return self._request

    def receive(self, message: Any, now: float) -> None:
        """Process any message of the vehicle."""
        if self._is_answer(message):
            self.outcome = ExchangeOutcome(True, message.get_type(), message)

    def tick(self, now: float) -> None:
        if self.outcome is not None or now + EPSILON_S < self.due_s:
            return
        if self._n_sent == self._attempts:
            self.outcome = ExchangeOutcome(False, f"no answer in {self._n_sent} attempts")
        else:
            self._transmit(now)


class Command(Exchange):
    """COMMAND_LONG or COMMAND_INT, repeated until the final acknowledgement to the station `sysid`."""

    def __init__(
        self, send: Send, request: Any, *, sysid: int = STATION[0], attempts: int | None = None
    ) -> None:
        super().__init__(send, request, attempts=attempts)
        self._sysid = sysid

    def message(self) -> Any:
        if self._request.get_type() == "COMMAND_LONG":
            self._request.confirmation = min(self._n_sent, 255)
        return self._request

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() != "COMMAND_ACK" or message.command != self._request.command:
            return
        if message.target_system not in (0, self._sysid):
            return
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            self.due_s = now + IN_PROGRESS_S
        else:
            text = enum_name("MAV_RESULT", message.result, "MAV_RESULT_")
            self.outcome = ExchangeOutcome(message.result == mavlink.MAV_RESULT_ACCEPTED, text, message)


class WaitUntilReady(Exchange):
    """A wait of at most `give_up_s` for the pre-arm bit in SYS_STATUS.

    After this time the exchange succeeds too, because the refusal of the next arming gives the reason. If the
    autopilot has no such bit, the wait ends with the first SYS_STATUS.
    """

    def __init__(self, send: Send, target: Target, give_up_s: float) -> None:
        status = mavlink.MAVLINK_MSG_ID_SYS_STATUS
        super().__init__(send, command_long(target, mavlink.MAV_CMD_REQUEST_MESSAGE, status))
        self._give_up_s, self._end_s = give_up_s, 0.0

    def begin(self, now: float) -> None:
        self._end_s = now + self._give_up_s
        super().begin(now)

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() != "SYS_STATUS":
            return
        self.due_s = now + self._resend_s  # delays the next request of the streamed message
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        if message.onboard_control_sensors_health & bit or not message.onboard_control_sensors_present & bit:
            self.outcome = ExchangeOutcome(True, "ready", message)

    def tick(self, now: float) -> None:
        super().tick(now)
        if self.outcome is None and now >= self._end_s:
            self.outcome = ExchangeOutcome(True, "not ready")


class ChangeMode(Command):
    """DO_SET_MODE, repeated until a refusal or a heartbeat in the mode; an autopilot may undo the change."""

    def __init__(self, send: Send, target: Target, number: int) -> None:
        super().__init__(send, set_mode(target, number))
        self._number = number

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() == "HEARTBEAT" and message.custom_mode == self._number:
            self.outcome = ExchangeOutcome(True, "ACCEPTED", message)
            return
        super().receive(message, now)
        if self.outcome is not None and self.outcome.accepted:
            self.outcome, self.due_s = None, now + 2 * RESEND_S  # longer wait for the heartbeat


class SetParameter(Exchange):
    """A read of a parameter for its type, then PARAM_SET until the vehicle answers with the value."""

    def __init__(self, send: Send, target: Target, name: str, value: float, *, byte_wise: bool) -> None:
        super().__init__(send)
        self._target, self._name, self._value, self._byte_wise = target, name, value, byte_wise
        self._type: int | None = None

    def message(self) -> Any:
        name = self._name.encode()
        if self._type is None:
            return mavlink.MAVLink_param_request_read_message(*self._target, name, -1)
        return mavlink.MAVLink_param_set_message(*self._target, name, self._wire(), self._type)

    def _wire(self) -> float:
        assert self._type is not None
        is_integer = self._byte_wise and self._type != mavlink.MAV_PARAM_TYPE_REAL32
        value = round(self._value) if is_integer else self._value
        return to_wire(value, self._type, byte_wise=self._byte_wise)

    def receive(self, message: Any, now: float) -> None:
        if message.get_type() != "PARAM_VALUE" or message.param_id != self._name:
            return
        if self._type is None:
            self._type = message.param_type
            self._transmit(now)
        else:
            same = struct.pack("<f", message.param_value) == struct.pack("<f", self._wire())
            text = "ACCEPTED" if same else f"{self._name} is {message.param_value:g}"
            self.outcome = ExchangeOutcome(same, text, message)


class UploadPlan(Exchange):
    """The upload of a mission, fence or rally points.

    An upload restarts after `STALLED_S` without a request; with a number of attempts it ends.
    """

    def __init__(
        self,
        send: Send,
        target: Target,
        items: Sequence[PlanItem],
        mission_type: int = MISSION,
        *,
        as_float: bool = False,
        sysid: int = STATION[0],
        attempts: int | None = None,
    ) -> None:
        super().__init__(send, attempts=attempts)
        self._target, self._items, self._type = target, items, mission_type
        self._as_float, self._sysid = as_float, sysid
        self.requests: list[tuple[str, int]] = []  # name and seq of each request of this attempt

    def message(self) -> Any:
        self.requests = []
        return mavlink.MAVLink_mission_count_message(*self._target, len(self._items), self._type)

    def receive(self, message: Any, now: float) -> None:
        kind = message.get_type()
        if kind not in (*REQUESTS, "MISSION_ACK") or message.mission_type != self._type:
            return
        if self.outcome is not None or message.target_system not in (0, self._sysid):
            return
        if kind in REQUESTS:
            self._answer(message, now)
        elif message.type != mavlink.MAV_MISSION_INVALID_SEQUENCE or not self.requests:
            # INVALID_SEQUENCE also answers a repeated item; the upload continues.
            text = enum_name("MAV_MISSION_RESULT", message.type, "MAV_MISSION_")
            self.outcome = ExchangeOutcome(message.type == mavlink.MAV_MISSION_ACCEPTED, text, message)

    def _answer(self, request: Any, now: float) -> None:
        self.requests.append((request.get_type(), request.seq))
        if request.seq >= len(self._items):
            text = f"the vehicle requested item {request.seq} of {len(self._items)}"
            self.outcome = ExchangeOutcome(False, text)
            return
        self.due_s = now + STALLED_S
        if self._attempts is not None:
            self._n_sent = self._attempts
        item = self._items[request.seq]
        self._send(item.message(self._target, request.seq, self._type, as_float=self._as_float))

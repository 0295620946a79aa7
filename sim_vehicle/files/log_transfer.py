"""Listing, download and erasure of flight logs over MAVLink, a state machine without I/O.

LOG_ENTRY and LOG_DATA have no target. ArduPilot serves one ground station at a time. During a transfer,
ArduPilot refuses LOG_REQUEST_LIST and LOG_REQUEST_DATA of other stations; LOG_REQUEST_END and LOG_ERASE of
any station end the transfer. PX4 serves several ground stations at once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files.logs.recorder import StoredLog
from sim_vehicle.files.pacing import BYTES_S, MAX_BYTES_AT_ONCE, Pacer

CHUNK_BYTES = 90  # log data in one LOG_DATA
FRAME_BYTES = 109  # size of LOG_DATA on the link
MAX_STATIONS = 8  # largest number of remembered list requests, one for each station


@dataclass(frozen=True, slots=True)
class LogRules:
    """The log transfer of one autopilot."""

    first_id: int  # id of the oldest log
    one_at_a_time: bool  # True: a transfer must end before the next transfer
    refused_armed: str  # STATUSTEXT of a refusal while armed; "": logs are served while armed
    list_first: bool  # True: data requires an earlier list request, which END, ERASE or a reboot cancels


ARDUPILOT = LogRules(
    first_id=1, one_at_a_time=True, refused_armed="Disarm for log download", list_first=False
)
PX4 = LogRules(first_id=0, one_at_a_time=False, refused_armed="", list_first=True)


@dataclass
class _Transfer:
    """A transfer to one ground station: a list of logs (`log` is None) or the bytes of a log."""

    next: int  # next id of the list, or next offset [bytes]
    last: int  # last id of the list, or end of the requested part [bytes]
    log: StoredLog | None = None
    log_id: int = 0


class LogTransfer:
    """The log server of one vehicle.

    logs: returns the logs, oldest first.
    erase: erases the logs.
    rules: the behaviour of the autopilot.
    send, send_text: called with each outgoing message and STATUSTEXT (severity, text).
    armed: returns True while the vehicle is armed.
    bytes_s, max_bytes_at_once: mean rate on the link [bytes/s], largest part sent at once [bytes].
    """

    def __init__(
        self,
        logs: Callable[[], list[StoredLog]],
        *,
        erase: Callable[[], None],
        rules: LogRules,
        send: Callable[[Any], None],
        send_text: Callable[[int, str], None],
        armed: Callable[[], bool],
        bytes_s: float = BYTES_S,
        max_bytes_at_once: float = MAX_BYTES_AT_ONCE,
    ) -> None:
        self._logs, self._erase, self._rules = logs, erase, rules
        self._send, self._send_text, self._armed = send, send_text, armed
        self._pacer = Pacer(bytes_s, max_bytes_at_once)
        self._transfers: dict[tuple[int, int], _Transfer] = {}
        self._listed: dict[tuple[int, int], None] = {}  # stations with a list request, latest last
        self._refusal_announced = False
        self._handlers: dict[str, Callable[[Any, tuple[int, int]], None]] = {
            "LOG_REQUEST_LIST": self._request_list,
            "LOG_REQUEST_DATA": self._request_data,
            "LOG_ERASE": self._request_erase,
            "LOG_REQUEST_END": self._request_end,
        }

    @property
    def busy(self) -> bool:
        """Return True during a transfer; each call of `tick` continues the transfer."""
        return bool(self._transfers)

    def receive(self, message: Any, now: float) -> None:
        """Process one log message at `now` [s]."""
        if self._rules.refused_armed and self._armed():
            if not self._refusal_announced:
                self._refusal_announced = True
                self._send_text(mavlink.MAV_SEVERITY_ERROR, self._rules.refused_armed)
            return
        self._refusal_announced = False
        peer = (message.get_srcSystem(), message.get_srcComponent())
        self._handlers[message.get_type()](message, peer)
        self.tick(now)

    def tick(self, now: float) -> None:
        """Send the messages due by `now` [s], one to each ground station in rotation."""
        if self._rules.refused_armed and self._armed():
            return
        while self._transfers:
            for peer, transfer in list(self._transfers.items()):
                if not self._pacer.take(FRAME_BYTES, now):
                    return
                if not self._continue(transfer):
                    del self._transfers[peer]

    def reset(self) -> None:
        """End the transfers after a reboot; the logs remain."""
        self._transfers.clear()
        self._listed.clear()
        self._refusal_announced = False

    # -- requests ----------------------------------------------------------------------------------------

    def _is_busy_for(self, peer: tuple[int, int]) -> bool:
        if not (self._rules.one_at_a_time and self._transfers):
            return False
        if peer not in self._transfers:  # a further request of the served station is ignored silently
            self._send_text(mavlink.MAV_SEVERITY_INFO, "Log download in progress")
        return True

    def _request_list(self, message: Any, peer: tuple[int, int]) -> None:
        if self._is_busy_for(peer):
            return
        self._remember_list_request(peer)
        first = self._rules.first_id
        newest = first + len(self._logs()) - 1
        if newest < first:
            self._transfers[peer] = _Transfer(next=0, last=0)
        else:
            last = min(message.end, newest)
            start = min(max(message.start, first), last) if first else min(message.start, newest)
            self._transfers[peer] = _Transfer(next=start, last=max(last, start))

    def _request_data(self, message: Any, peer: tuple[int, int]) -> None:
        if self._is_busy_for(peer):
            return
        if self._rules.list_first and peer not in self._listed:
            return
        index, logs = message.id - self._rules.first_id, self._logs()
        if not 0 <= index < len(logs):
            self._transfers.pop(peer, None)
            return
        end = max(min(message.ofs + message.count, len(logs[index].content)), message.ofs)
        self._transfers[peer] = _Transfer(message.ofs, end, logs[index], message.id)

    def _request_erase(self, _message: Any, _peer: tuple[int, int]) -> None:
        self._transfers.clear()
        self._listed.clear()
        self._erase()

    def _request_end(self, _message: Any, peer: tuple[int, int]) -> None:
        if self._rules.one_at_a_time:
            self._transfers.clear()
        self._transfers.pop(peer, None)
        self._listed.pop(peer, None)

    def _remember_list_request(self, peer: tuple[int, int]) -> None:
        self._listed.pop(peer, None)
        if len(self._listed) >= MAX_STATIONS:
            forgotten = next(iter(self._listed))
            del self._listed[forgotten]
            self._transfers.pop(forgotten, None)
        self._listed[peer] = None

    # -- sending -----------------------------------------------------------------------------------------

    def _continue(self, transfer: _Transfer) -> bool:
        """Send the next message; return True if further messages follow."""
        if transfer.log is None:
            self._send_entry(transfer)
            transfer.next += 1
            return transfer.next <= transfer.last
        data = bytes(transfer.log.content[transfer.next : min(transfer.next + CHUNK_BYTES, transfer.last)])
        padded = data.ljust(CHUNK_BYTES, b"\0")
        self._send(mavlink.MAVLink_log_data_message(transfer.log_id, transfer.next, len(data), padded))
        transfer.next += len(data)
        return len(data) == CHUNK_BYTES and transfer.next < transfer.last

    def _send_entry(self, transfer: _Transfer) -> None:
        logs, index = self._logs(), transfer.next - self._rules.first_id
        utc_s = size = 0
        if 0 <= index < len(logs):  # else no log has this id; the entry is empty
            utc_s, size = max(int(logs[index].utc_s), 0), len(logs[index].content)
        self._send(mavlink.MAVLink_log_entry_message(transfer.next, len(logs), transfer.last, utc_s, size))

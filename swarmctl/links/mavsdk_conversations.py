"""Mission transfers by MAVSDK, and the gate between MAVSDK and a vehicle. No I/O.

| conversation | by |
|---|---|
| commands: one message, without MAVSDK's repetitions and time-outs | MAVSDK |
| uploads and read-backs of whole missions | MAVSDK |
| parts of a mission: MAVSDK has none | this program |
| uploads that may keep the current item and withhold the last: MAVSDK can do neither | this program |
| fences, parameters, MISSION_SET_CURRENT | this program |
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import Conversation
from swarmctl.mavlink.protocol.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.protocol.mission_transfer import MISSION
from swarmctl.mavlink.protocol.mission_upload import Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.protocol.procedure import Procedure

R = TypeVar("R")
OnEnd = Callable[[str, tuple[MissionItem, ...]], None]
"""called with the name of MAVSDK's MissionRawResult, and with the items of a download"""


class MissionTransfers(Protocol):
    """MAVSDK's transfers with one vehicle. Each call returns at once; `on_end` is called later."""

    @property
    def is_transferring(self) -> bool: ...

    def begin_upload(self, items: Sequence[MissionItem], current: int, on_end: OnEnd) -> None: ...

    def begin_download(self, on_end: OnEnd) -> None: ...

    def cancel_transfer(self) -> None: ...


class MavsdkTransfer(Conversation[R]):
    """Transfer of a whole mission by MAVSDK, which has its own time-outs."""

    LIMIT_S = 300.0
    """longest wait for MAVSDK's answer; enough for 200 items with 20 % loss in both directions"""
    POLL_S = 0.02

    def __init__(
        self, mavsdk: MissionTransfers, begin: Callable[[OnEnd], None], result_of: Callable[..., R]
    ) -> None:
        super().__init__()
        self._mavsdk = mavsdk
        self._begin_transfer = begin
        self._result_of = result_of
        self._has_begun = False
        self._end: tuple[str, tuple[MissionItem, ...]] | None = None
        self._until_s = 0.0

    def _begin(self, now: float) -> list[Message]:
        self._until_s = now + self.LIMIT_S
        return self._on_deadline(now)

    def _on_message(self, message: Message, now: float) -> list[Message]:
        return self._on_deadline(now)

    def _on_deadline(self, now: float) -> list[Message]:
        self.next_deadline = now + self.POLL_S
        # MAVSDK answers BUSY until an earlier, cancelled transfer has ended.
        if not self._has_begun and not self._mavsdk.is_transferring:
            self._has_begun = True
            self._begin_transfer(self._ended)
        if self._end is None and now >= self._until_s:
            self._closing_messages(now)
            self._end = ("TIMEOUT", ())
        if self._end is not None:
            self._finish(self._result_of(*self._end))
        return []

    def _ended(self, name: str, items: tuple[MissionItem, ...]) -> None:
        self._end = (name, items)

    def _closing_messages(self, now: float) -> list[Message]:
        self._mavsdk.cancel_transfer()
        return []


# Another try or a read-back may turn any outcome but REJECTED into a success.
_UPLOAD_OUTCOMES: dict[str, UploadOutcome] = {
    "SUCCESS": UploadOutcome.ACCEPTED,
    # Perhaps all items are stored and only the last acknowledgement is lost.
    "TIMEOUT": UploadOutcome.UNCONFIRMED,
    "ERROR": UploadOutcome.UNCONFIRMED,
    "PROTOCOL_ERROR": UploadOutcome.UNCONFIRMED,
    # ArduPilot sends this answer to a repeated item and continues, but MAVSDK ends the transfer.
    "INVALID_SEQUENCE": UploadOutcome.INCOMPLETE,
    "TRANSFER_CANCELLED": UploadOutcome.CANCELLED,
    "BUSY": UploadOutcome.DENIED,
    "DENIED": UploadOutcome.DENIED,
    "NO_SYSTEM": UploadOutcome.DENIED,
}
_DOWNLOAD_OUTCOMES: dict[str, DownloadOutcome] = {
    "SUCCESS": DownloadOutcome.COMPLETE,
    "NO_MISSION_AVAILABLE": DownloadOutcome.COMPLETE,
    "TIMEOUT": DownloadOutcome.NO_ANSWER,
}


def _upload_result(name: str, _items: tuple[MissionItem, ...]) -> UploadResult:
    outcome = _UPLOAD_OUTCOMES.get(name, UploadOutcome.REJECTED)
    return UploadResult(outcome, f"upload {outcome.value}: MAVSDK reports {name}")


def _download_result(name: str, items: tuple[MissionItem, ...]) -> DownloadResult:
    outcome = _DOWNLOAD_OUTCOMES.get(name, DownloadOutcome.REFUSED)
    return DownloadResult(outcome, items, f"read-back {outcome.value}: MAVSDK reports {name}")


def with_mavsdk(procedure: Procedure[R], mavsdk: MissionTransfers) -> Procedure[R]:
    """Run a procedure with its transfers of whole missions by MAVSDK."""
    answer: Any = None
    try:
        while True:
            try:
                conversation = procedure.send(answer)
            except StopIteration as stop:
                result: R = stop.value
                return result
            answer = yield _by_mavsdk(conversation, mavsdk)
    finally:
        procedure.close()


def _by_mavsdk(direct: Conversation[Any], mavsdk: MissionTransfers) -> Conversation[Any]:
    match direct:
        case Upload() if direct.mission_type == MISSION and direct.too_late is None:
            # MAVSDK sends only missions with exactly one current item: item 0 if no item is marked.
            items, current = direct.items, direct.current or 0
            return MavsdkTransfer(
                mavsdk, lambda on_end: mavsdk.begin_upload(items, current, on_end), _upload_result
            )
        case Download() if direct.mission_type == MISSION and direct.first == 0:
            return MavsdkTransfer(mavsdk, mavsdk.begin_download, _download_result)
    return direct


_ALWAYS_IN = ("HEARTBEAT", "AUTOPILOT_VERSION")
_TRANSFER = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_INT")
_TRANSFER_OUT = (*_TRANSFER, "MISSION_REQUEST_LIST")
_TRANSFER_IN = (*_TRANSFER, "MISSION_REQUEST", "MISSION_ACK")


class MavsdkGate:
    """Filter of the messages between MAVSDK and one vehicle.

    MAVSDK sends commands of its own. A command passes once, exactly as requested, and soon after the request:
    a late command could reach a vehicle after a pilot has taken over. MAVSDK receives heartbeats, versions
    and the messages of its transfers. `is_transferring`: True while MAVSDK transfers a mission.
    """

    VALID_S = 1.0
    """longest time from the request of a command to its sending"""

    def __init__(self) -> None:
        self.is_transferring = False
        self._permitted_until_s: dict[tuple[int, bytes], float] = {}

    def permit(self, command: Message, now: float) -> None:
        """Permit this COMMAND_LONG once."""
        self._permitted_until_s[_content(command)] = now + self.VALID_S

    def lets_out(self, message: Message, now: float) -> bool:
        """Return whether MAVSDK's message may go to the vehicle; a command uses up its permission."""
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            return now < self._permitted_until_s.pop(_content(message), now)
        # MAVSDK sends the last MISSION_ACK after it has reported the end of the transfer.
        return kind == "MISSION_ACK" or (self.is_transferring and kind in _TRANSFER_OUT)

    def lets_in(self, message: Message) -> bool:
        """Return whether MAVSDK receives the vehicle's message."""
        kind = message.get_type()
        return kind in _ALWAYS_IN or (self.is_transferring and kind in _TRANSFER_IN)


def _content(command: Message) -> tuple[int, bytes]:
    """Return a command's number and parameters, rounded as on the wire."""
    params = (getattr(command, f"param{i}") for i in range(1, 8))
    return int(command.command), struct.pack("<7f", *params)

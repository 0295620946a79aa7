"""Conversations by MAVSDK, and the gate between MAVSDK and a vehicle. No I/O.

These conversations replace `Command`, `Upload` and `Download` in the procedures. The procedures still decide
by telemetry when a command may be sent.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import Command, CommandResult, name_of
from swarmctl.mavlink.protocol.conversation import Conversation
from swarmctl.mavlink.protocol.mission_download import Download, DownloadOutcome, DownloadResult
from swarmctl.mavlink.protocol.mission_upload import MISSION, Upload, UploadOutcome, UploadResult
from swarmctl.mavlink.protocol.procedure import Procedure

R = TypeVar("R")
TransferEnd = tuple[str, tuple[MissionItem, ...]]
"""name of MAVSDK's MissionRawResult, and the items of a download"""


class MavsdkAdapter(Protocol):
    """MAVSDK for one vehicle. Each call returns at once; `then` is called in a later turn of the loop."""

    def command(self, message: Message, then: Callable[[Message], None]) -> None:
        """Send a command; call `then` with the final COMMAND_ACK, if one arrives."""

    def give_up(self, message: Message) -> None:
        """Stop the repetitions of a command and the wait for its answer."""

    def upload(
        self, items: Sequence[MissionItem], current: int, then: Callable[[TransferEnd], None]
    ) -> None: ...

    def download(self, then: Callable[[TransferEnd], None]) -> None: ...

    def cancel_transfer(self) -> None: ...


class ByMavsdk(Conversation[R]):
    """Base of conversations by MAVSDK; `on_end` continues the procedure after MAVSDK's answer."""

    def __init__(self, adapter: MavsdkAdapter, on_end: Callable[[], None]) -> None:
        super().__init__()
        self._adapter = adapter
        self._on_end = on_end


class CommandByMavsdk(ByMavsdk[CommandResult]):
    """One try of a command by MAVSDK; `command`, the direct conversation, has deadlines and result."""

    def __init__(
        self, command: Command, adapter: MavsdkAdapter, on_end: Callable[[], None], clock: Callable[[], float]
    ) -> None:
        super().__init__(adapter, on_end)
        self._command = command
        self._clock = clock
        self._message: Message = None

    def _begin(self, now: float) -> list[Message]:
        (self._message,) = self._command.start(now)
        self._adapter.command(self._message, self._answered)
        return self._copy_state()

    def _answered(self, ack: Message) -> None:
        if self.result is None and self._is_running("an answer"):
            self._command.receive(ack, self._clock())
            self._copy_state()
            self._on_end()

    def _on_message(self, message: Message, now: float) -> list[Message]:
        # MAVSDK does not report IN_PROGRESS and keeps waiting, so this conversation also waits.
        if message.get_type() == "COMMAND_ACK" and name_of("MAV_RESULT", message.result) == "IN_PROGRESS":
            self._command.receive(message, now)
        return self._copy_state()

    def _on_deadline(self, now: float) -> list[Message]:
        self._command.tick(now)
        return self._copy_state()

    def _closing_messages(self, now: float) -> list[Message]:
        self._adapter.give_up(self._message)
        return []

    def _copy_state(self) -> list[Message]:
        self.next_deadline = self._command.next_deadline
        if self._command.result is not None:
            self._adapter.give_up(self._message)
            self._finish(self._command.result)
        return []


class _Transfer(ByMavsdk[R]):
    """Transfer by MAVSDK, which has its own time-outs; `limit_s`: longest wait for MAVSDK's callback."""

    limit_s = 60.0

    def _start_transfer(self, then: Callable[[TransferEnd], None]) -> None:
        raise NotImplementedError

    def _result_of(self, name: str, items: tuple[MissionItem, ...]) -> R:
        raise NotImplementedError

    def _begin(self, now: float) -> list[Message]:
        self.next_deadline = now + self.limit_s
        self._start_transfer(self._ended)
        return []

    def _ended(self, end: TransferEnd) -> None:
        if self._is_running("an end"):
            self._finish(self._result_of(*end))
            self._on_end()

    def _on_message(self, message: Message, now: float) -> list[Message]:
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        self._adapter.cancel_transfer()
        self._finish(self._result_of("TIMEOUT", ()))
        return []

    def _closing_messages(self, now: float) -> list[Message]:
        self._adapter.cancel_transfer()
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


class UploadByMavsdk(_Transfer[UploadResult]):
    """MissionRaw.upload_mission."""

    def __init__(self, upload: Upload, adapter: MavsdkAdapter, on_end: Callable[[], None]) -> None:
        super().__init__(adapter, on_end)
        self._upload = upload
        self.limit_s = 20.0 + 2.0 * len(upload.items)

    def _start_transfer(self, then: Callable[[TransferEnd], None]) -> None:
        # MAVSDK sends only missions with exactly one current item: item 0 if no item is marked.
        self._adapter.upload(self._upload.items, self._upload.current or 0, then)

    def _result_of(self, name: str, items: tuple[MissionItem, ...]) -> UploadResult:
        outcome = _UPLOAD_OUTCOMES.get(name, UploadOutcome.REJECTED)
        return UploadResult(outcome, f"upload {outcome.value}: MAVSDK reports {name}")


class DownloadByMavsdk(_Transfer[DownloadResult]):
    """MissionRaw.download_mission."""

    limit_s = 300.0
    """enough for 200 items with 20 % loss in both directions"""

    def _start_transfer(self, then: Callable[[TransferEnd], None]) -> None:
        self._adapter.download(then)

    def _result_of(self, name: str, items: tuple[MissionItem, ...]) -> DownloadResult:
        if name in ("SUCCESS", "NO_MISSION_AVAILABLE"):
            outcome = DownloadOutcome.COMPLETE
        elif name == "TIMEOUT":
            outcome = DownloadOutcome.NO_ANSWER
        else:
            outcome = DownloadOutcome.REFUSED
        return DownloadResult(outcome, items, f"read-back {outcome.value}: MAVSDK reports {name}")


def with_mavsdk(
    procedure: Procedure[R], adapter: MavsdkAdapter, on_end: Callable[[], None], clock: Callable[[], float]
) -> Procedure[R]:
    """Run a procedure with its commands, and its transfers of whole missions, by MAVSDK.

    These conversations stay with this program:
    - parts of a mission, which MAVSDK cannot transfer
    - MISSION_SET_CURRENT
    - an upload that may keep the current item (`flown`): MAVSDK always marks an item as current
    - fences and parameters
    - requests that change nothing on the vehicle
    """
    answer: Any = None
    try:
        while True:
            try:
                conversation = procedure.send(answer)
            except StopIteration as stop:
                result: R = stop.value
                return result
            answer = yield _by_mavsdk(conversation, adapter, on_end, clock)
    finally:
        procedure.close()


def _by_mavsdk(
    direct: Conversation[Any], adapter: MavsdkAdapter, on_end: Callable[[], None], clock: Callable[[], float]
) -> Conversation[Any]:
    match direct:
        case Command():
            return CommandByMavsdk(direct, adapter, on_end, clock)
        case Upload() if direct.mission_type == MISSION and direct.flown is None:
            return UploadByMavsdk(direct, adapter, on_end)
        case Download() if direct.mission_type == MISSION and direct.first == 0:
            return DownloadByMavsdk(adapter, on_end)
    return direct


_ALWAYS_IN = ("HEARTBEAT", "AUTOPILOT_VERSION")
_TRANSFER_OUT = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT")
_TRANSFER_IN = (
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_ACK",
)


class MavsdkGate:
    """Filter of the messages between MAVSDK and one vehicle.

    MAVSDK repeats unanswered commands. A repeated command could reach a vehicle after a pilot has taken over,
    so each command passes once, exactly as requested. MAVSDK receives heartbeats, versions and answers to its
    own messages. `is_transferring`: True while MAVSDK transfers a mission.
    """

    def __init__(self) -> None:
        self.is_transferring = False
        self._permitted: set[tuple[int, bytes]] = set()
        self._awaited_acks: set[int] = set()

    def permit(self, command: Message) -> None:
        """Permit this COMMAND_LONG once, and its acknowledgements."""
        self._permitted.add(_content(command))
        self._awaited_acks.add(int(command.command))

    def revoke(self, command: Message) -> None:
        """End the permission of this command."""
        self._permitted.discard(_content(command))
        self._awaited_acks.discard(int(command.command))

    def lets_out(self, message: Message) -> bool:
        """Return whether MAVSDK's message may go to the vehicle; a command uses up its permission."""
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            content = _content(message)
            permitted = content in self._permitted
            self._permitted.discard(content)
            return permitted
        # MAVSDK sends the last MISSION_ACK after it has reported the end of the transfer.
        return kind == "MISSION_ACK" or (self.is_transferring and kind in _TRANSFER_OUT)

    def lets_in(self, message: Message) -> bool:
        """Return whether MAVSDK receives the vehicle's message."""
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            return int(message.command) in self._awaited_acks
        return kind in _ALWAYS_IN or (self.is_transferring and kind in _TRANSFER_IN)


def _content(command: Message) -> tuple[int, bytes]:
    """Return a command's number and parameters, rounded as on the wire."""
    params = (getattr(command, f"param{i}") for i in range(1, 8))
    return int(command.command), struct.pack("<7f", *params)

"""Conversations that MAVSDK holds for us, in the form of our own. Pure.

They take the place of `Command`, `Upload` and `Download` in the procedures: those go on deciding when a
vehicle may be told something, by its telemetry, whoever tells it.
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
"""MAVSDK's MissionRawResult by name, and the items of a download"""


class MavsdkAdapter(Protocol):
    """MAVSDK for one vehicle. Each call returns at once; `then` is called in a later turn of the loop."""

    def command(self, message: Message, then: Callable[[Message], None]) -> None:
        """`then` with the final COMMAND_ACK, and not at all where none comes."""

    def give_up(self, message: Message) -> None:
        """Nobody waits for this command any more, and none of it may be sent."""

    def upload(
        self, items: Sequence[MissionItem], current: int, then: Callable[[TransferEnd], None]
    ) -> None: ...

    def download(self, then: Callable[[TransferEnd], None]) -> None: ...

    def cancel_transfer(self) -> None: ...


class ByMavsdk(Conversation[R]):
    """`on_end` is called when MAVSDK has answered; whoever drives the procedure has to look then."""

    def __init__(self, adapter: MavsdkAdapter, on_end: Callable[[], None]) -> None:
        super().__init__()
        self._adapter = adapter
        self._on_end = on_end


class CommandByMavsdk(ByMavsdk[CommandResult]):
    """`own` keeps the deadlines and says what an answer means; MAVSDK sends, and hears the answer."""

    def __init__(
        self, own: Command, adapter: MavsdkAdapter, on_end: Callable[[], None], clock: Callable[[], float]
    ) -> None:
        super().__init__(adapter, on_end)
        self._own = own
        self._clock = clock
        self._message: Message = None

    def _begin(self, now: float) -> list[Message]:
        (self._message,) = self._own.start(now)
        self._adapter.command(self._message, self._answered)
        return self._follow()

    def _answered(self, ack: Message) -> None:
        if self.result is None and self._is_running("an answer"):
            self._own.receive(ack, self._clock())
            self._follow()
            self._on_end()

    def _on_message(self, message: Message, now: float) -> list[Message]:
        # MAVSDK keeps these to itself: it waits on, and so must we.
        if message.get_type() == "COMMAND_ACK" and name_of("MAV_RESULT", message.result) == "IN_PROGRESS":
            self._own.receive(message, now)
        return self._follow()

    def _on_deadline(self, now: float) -> list[Message]:
        self._own.tick(now)
        return self._follow()

    def _closing_messages(self, now: float) -> list[Message]:
        self._adapter.give_up(self._message)
        return []

    def _follow(self) -> list[Message]:
        self.next_deadline = self._own.next_deadline
        if self._own.result is not None:
            self._adapter.give_up(self._message)
            self._finish(self._own.result)
        return []


class _Transfer(ByMavsdk[R]):
    """MAVSDK has time-outs of its own; `limit_s` is for the case that it never calls back."""

    limit_s = 60.0

    def _start_transfer(self, then: Callable[[TransferEnd], None]) -> None:
        raise NotImplementedError

    def _result_of(self, name: str, items: tuple[MissionItem, ...]) -> R:
        raise NotImplementedError

    def _begin(self, now: float) -> list[Message]:
        self.next_deadline = now + self.limit_s
        self._start_transfer(self._ended)
        return []

    def _ended(self, said: TransferEnd) -> None:
        if self._is_running("an end"):
            self._finish(self._result_of(*said))
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


# What another try, or reading back, may show to be well after all.
_UPLOADED: dict[str, UploadOutcome] = {
    "SUCCESS": UploadOutcome.ACCEPTED,
    # The items may all be there and only the last word lost.
    "TIMEOUT": UploadOutcome.UNCONFIRMED,
    "ERROR": UploadOutcome.UNCONFIRMED,
    "PROTOCOL_ERROR": UploadOutcome.UNCONFIRMED,
    # ArduPilot says so of an item that came twice, and asks on: MAVSDK has left it alone with that.
    "INVALID_SEQUENCE": UploadOutcome.INCOMPLETE,
    "TRANSFER_CANCELLED": UploadOutcome.CANCELLED,
    "BUSY": UploadOutcome.DENIED,
    "DENIED": UploadOutcome.DENIED,
    "NO_SYSTEM": UploadOutcome.DENIED,
}


class UploadByMavsdk(_Transfer[UploadResult]):
    """MissionRaw.upload_mission."""

    def __init__(self, own: Upload, adapter: MavsdkAdapter, on_end: Callable[[], None]) -> None:
        super().__init__(adapter, on_end)
        self._own = own
        self.limit_s = 20.0 + 2.0 * len(own.items)

    def _start_transfer(self, then: Callable[[TransferEnd], None]) -> None:
        # MAVSDK sends only what has exactly one current item; on the ground the first is, anyway.
        self._adapter.upload(self._own.items, self._own.current or 0, then)

    def _result_of(self, name: str, items: tuple[MissionItem, ...]) -> UploadResult:
        outcome = _UPLOADED.get(name, UploadOutcome.REJECTED)
        return UploadResult(outcome, f"upload {outcome.value}: MAVSDK says {name}")


class DownloadByMavsdk(_Transfer[DownloadResult]):
    """MissionRaw.download_mission."""

    # A mission of 200 items with every fifth message lost, both ways.
    limit_s = 300.0

    def _start_transfer(self, then: Callable[[TransferEnd], None]) -> None:
        self._adapter.download(then)

    def _result_of(self, name: str, items: tuple[MissionItem, ...]) -> DownloadResult:
        if name in ("SUCCESS", "NO_MISSION_AVAILABLE"):
            outcome = DownloadOutcome.COMPLETE
        elif name == "TIMEOUT":
            outcome = DownloadOutcome.NO_ANSWER
        else:
            outcome = DownloadOutcome.REFUSED
        return DownloadResult(outcome, items, f"read-back {outcome.value}: MAVSDK says {name}")


def with_mavsdk(
    procedure: Procedure[R], adapter: MavsdkAdapter, on_end: Callable[[], None], clock: Callable[[], float]
) -> Procedure[R]:
    """`procedure`, whose commands, and uploads and downloads of whole missions, are MAVSDK's to hold.

    What stays ours: parts of a mission and MISSION_SET_CURRENT, which MAVSDK does not have; a mission for who
    flies one, whose current item is to stay what it is, for MAVSDK sends none without one to begin with;
    fences; and requests that only look, and change nothing on a vehicle.
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
    own: Conversation[Any], adapter: MavsdkAdapter, on_end: Callable[[], None], clock: Callable[[], float]
) -> Conversation[Any]:
    match own:
        case Command():
            return CommandByMavsdk(own, adapter, on_end, clock)
        case Upload() if own.mission_type == MISSION and own.flown is None:
            return UploadByMavsdk(own, adapter, on_end)
        case Download() if own.mission_type == MISSION and own.first == 0:
            return DownloadByMavsdk(adapter, on_end)
    return own


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
    """Of one vehicle. `transfer` is whether MAVSDK moves a mission at the moment."""

    def __init__(self) -> None:
        self.transfer = False
        self._may_leave: set[tuple[int, bytes]] = set()
        self._asked: set[int] = set()

    def permit(self, command: Message) -> None:
        """Let this COMMAND_LONG out once, and its acknowledgements in."""
        self._may_leave.add(_content(command))
        self._asked.add(int(command.command))

    def revoke(self, command: Message) -> None:
        """It is over: nothing of it goes out any more."""
        self._may_leave.discard(_content(command))
        self._asked.discard(int(command.command))

    def lets_out(self, message: Message) -> bool:
        """Whether MAVSDK's message goes to the vehicle; a command uses up its permission."""
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            content = _content(message)
            permitted = content in self._may_leave
            self._may_leave.discard(content)
            return permitted
        # The last word of a transfer comes when it is over already.
        return kind == "MISSION_ACK" or (self.transfer and kind in _TRANSFER_OUT)

    def lets_in(self, message: Message) -> bool:
        """Whether MAVSDK is told what the vehicle says."""
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            return int(message.command) in self._asked
        return kind in _ALWAYS_IN or (self.transfer and kind in _TRANSFER_IN)


def _content(command: Message) -> tuple[int, bytes]:
    """All that matters of it, rounded as it is on the wire."""
    params = (getattr(command, f"param{i}") for i in range(1, 8))
    return int(command.command), struct.pack("<7f", *params)

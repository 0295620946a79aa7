"""Evidence entries from the MAVLink messages to and from one vehicle: commands and acknowledgements. Pure.

- Keep-alive messages, mission requests and mission items make no entry when sent. Other messages do.
- The items of an upload make an entry with their number and hash when the upload ends. A call of
  `unrecorded_entries` during the upload makes an entry of the items so far.
- Several MISSION_WRITE_PARTIAL_LIST in a row are one upload. The first list makes an entry.
  `unrecorded_entries` counts their MISSION_ACKs by result.
"""

from __future__ import annotations

from typing import Any

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import name_of
from swarmctl.mavlink.protocol.parameters import BYTE_WISE, decoded
from swarmctl.report.evidence.transfer import ANNOUNCEMENTS, PARTIAL, NewEntry, Transfer

KEEP_ALIVE = frozenset({"HEARTBEAT", "PING", "SYSTEM_TIME", "TIMESYNC"})
"""messages that keep a link alive or compare clocks"""
ITEMS = frozenset({"MISSION_ITEM_INT", "MISSION_ITEM"})
_REQUESTS = frozenset({"MISSION_REQUEST_INT", "MISSION_REQUEST"})
_OMITTED_FIELDS = frozenset({"target_system", "target_component", "mavpackettype"})


def arms(message: Message) -> bool:
    """Return whether a message asks a vehicle to arm; PX4 also arms to start a mission."""
    if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT"):
        return False
    command = name_of("MAV_CMD", int(message.command))
    return command == "MISSION_START" or (command == "COMPONENT_ARM_DISARM" and message.param1 != 0.0)


class Traffic:
    """Messages from one station to one vehicle, and the vehicle's answers, in the order of the wire."""

    def __init__(self) -> None:
        self._upload: Transfer | None = None
        self._download: Transfer | None = None
        self.byte_wise = False
        """True if the vehicle, by its last heartbeat, sends integer parameters as bytes"""
        self._asked: set[str] = set()
        """names of parameters that were set or requested, without an answer yet"""

    def sent(self, message: Message) -> list[NewEntry]:
        kind = message.get_type()
        if kind in KEEP_ALIVE or kind in _REQUESTS:
            return []
        if kind in ITEMS:
            if self._upload is None:
                self._upload = Transfer(int(message.mission_type))
            self._upload.add_item(message)
            return []
        if kind == PARTIAL and (upload := self._partial_upload_of(message)) is not None:
            upload.announce(message)
            return []
        return [
            *self._begin_or_end(kind, message),
            ("command", {**self._content(message), **self._read_back(kind)}),
        ]

    def received(self, message: Message) -> list[NewEntry]:
        match message.get_type():
            case "HEARTBEAT":
                self.byte_wise = int(message.autopilot) in BYTE_WISE
            case "COMMAND_ACK":
                result = name_of("MAV_RESULT", int(message.result))
                command = name_of("MAV_CMD", int(message.command))
                return [("acknowledgement", {"message": "COMMAND_ACK", "command": command, "result": result})]
            case "MISSION_ACK":
                content = self._content(message)
                if (upload := self._partial_upload_of(message)) is not None:
                    upload.answers[content["result"]] += 1
                    return []
                # ArduPilot answers INVALID_SEQUENCE to a repeated item, and continues the transfer.
                ended = [] if content["result"] == "INVALID_SEQUENCE" else self.unrecorded_entries()
                return [*ended, ("acknowledgement", content)]
            case "MISSION_ITEM_INT" | "MISSION_ITEM" if self._download is not None:
                self._download.add_item(message)
            case "MISSION_COUNT" if self._download is not None:
                self._download.count = int(message.count)
            case "PARAM_VALUE" if _name(message) in self._asked:
                self._asked.discard(_name(message))
                return [("acknowledgement", self._content(message))]
        return []

    def _content(self, message: Message) -> dict[str, Any]:
        content = _content(message)
        if message.get_type() in ("PARAM_SET", "PARAM_VALUE") and self.byte_wise:
            content["param_value"] = decoded(message, byte_wise=True).value
        return content

    def unrecorded_entries(self) -> list[NewEntry]:
        """Return entries for items and answers of the upload that have no entry yet."""
        return [] if self._upload is None else self._upload.unrecorded_entries()

    def _begin_or_end(self, kind: str, message: Message) -> list[NewEntry]:
        """Begin the transfer that a sent message announces; return entries that end the previous upload."""
        entries: list[NewEntry] = []
        if kind in ANNOUNCEMENTS or kind == "MISSION_ACK" or self._is_partial:
            entries = self.unrecorded_entries()
        if self._is_partial and kind != "MISSION_REQUEST_LIST":  # A read-back does not end the upload.
            self._upload = None
        if kind == "MISSION_COUNT":
            self._upload = Transfer(int(message.mission_type), int(message.count))
        elif kind == PARTIAL:
            self._upload = Transfer(int(message.mission_type))
            self._upload.announce(message)
        elif kind == "MISSION_REQUEST_LIST":
            self._download = Transfer(int(message.mission_type))
        elif kind in ("PARAM_SET", "PARAM_REQUEST_READ"):
            self._asked.add(_name(message))
        return entries

    @property
    def _is_partial(self) -> bool:
        return self._upload is not None and self._upload.is_partial

    def _partial_upload_of(self, message: Message) -> Transfer | None:
        """Return the running upload by partial lists if it has the message's mission type."""
        upload = self._upload
        belongs = upload is not None and upload.is_partial and upload.mission_type == message.mission_type
        return upload if belongs else None

    def _read_back(self, kind: str) -> dict[str, Any]:
        """Return {"read": downloaded items} if a sent MISSION_ACK ends the download; else {}."""
        if kind != "MISSION_ACK" or self._download is None:
            return {}
        transfer, self._download = self._download, None
        return {"read": transfer.content()}


def _content(message: Message) -> dict[str, Any]:
    kind = message.get_type()
    content = {
        "message": kind,
        **{k: _text(v) for k, v in message.to_dict().items() if k not in _OMITTED_FIELDS},
    }
    # The key is a secret; the fact that a key was sent is not.
    content.pop("secret_key", None)
    if kind in ("COMMAND_LONG", "COMMAND_INT"):
        content["command"] = name_of("MAV_CMD", int(message.command))
    if "mission_type" in content:
        content["mission_type"] = name_of("MAV_MISSION_TYPE", int(message.mission_type))
    if kind == "MISSION_ACK":
        result = name_of("MAV_MISSION_RESULT", int(content.pop("type")))
        content["result"] = result.removeprefix("MAV_MISSION_")
    return content


def _name(message: Message) -> str:
    return str(_text(message.param_id))


def _text(value: Any) -> Any:
    return value.rstrip("\0") if isinstance(value, str) else value

"""Evidence for tests: a file in writing, chains as a forger writes them, and tlogs."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import logged_frames
from swarmctl.report.evidence.chain import GENESIS, Opened, sha256, signed_content
from swarmctl.report.evidence.log import FILE_NAME, Evidence
from swarmctl.security.evidence_keys import EvidenceSigner

Json = dict[str, Any]

STATION = 255
UNRECORDED = ("HEARTBEAT", "TIMESYNC", "MISSION_REQUEST_INT")

ARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
DISARM = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0)
HOLD = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)


class Written:
    """The evidence of vehicle alpha, system 1, in writing."""

    def __init__(self, folder: Path, now: Callable[[], float] = lambda: 0.0, **more: Any) -> None:
        self.said: list[str] = []
        self.file = folder / FILE_NAME
        opened = Opened(run="test", vehicles={"alpha": 1})
        self.evidence = Evidence(
            self.file, opened, now=now, unix_s_at_zero=1.7e9, say=self.said.append, **more
        )

    @classmethod
    def in_loop(cls, folder: Path) -> Written:
        return cls(folder, asyncio.get_running_loop().time, waits_in_thread=True)

    @property
    def lines(self) -> list[Json]:
        return [json.loads(line) for line in self.file.read_bytes().splitlines()]

    @property
    def commands(self) -> list[Json]:
        return [line["what"] for line in self.lines if line["kind"] == "command"]

    def fill_disk(self) -> None:
        """Let each later write fail, as on a full disk."""
        full = os.open("/dev/full", os.O_WRONLY)
        os.dup2(full, self.evidence._file.fileno())
        os.close(full)


def entries(*contents: tuple[str, Json], vehicle: str | None = "alpha", **opened: Any) -> list[Json]:
    """Return the entries of a closed run, without hashes."""
    kinds = [("opened", {"vehicles": {"alpha": 1}, **opened}), *contents, ("closed", {})]
    return [
        {
            "n": n,
            "unix_s": 1.7e9 + n,
            "run_s": n + 0.5,
            "vehicle": vehicle if n else None,
            "kind": k,
            "what": w,
        }
        for n, (k, w) in enumerate(kinds)
    ]


def chained(run: list[Json], signer: EvidenceSigner | None = None) -> list[bytes]:
    """Return the lines of entries with valid hashes, signed in the last line, as a forger writes them."""
    lines, previous = [], GENESIS
    for entry in run:
        if entry is run[-1] and signer is not None:
            signature = signer.sign(signed_content(len(run) - 1, previous, entry["what"].get("files", {})))
            signed = {"by": signer.name, "key": signer.public_key, "signature": signature}
            entry["what"].setdefault("signature", signed)
        body = json.dumps({**entry, "previous": previous}, separators=(",", ":")).encode()
        previous = sha256(body)
        lines.append(b'{"hash":"%s",%s\n' % (previous.encode(), body[1:]))
    return lines


def tlog(*messages: tuple[int, Any]) -> bytes:
    """Return a tlog of messages, each with the system id of its sender."""
    return b"".join(
        bytes(8) + bytes(message.pack(mavlink.MAVLink(None, sender, 1))) for sender, message in messages
    )


def sent_to(tlog: Path) -> list[Any]:
    """Return the ground station's messages from the tlog, without heartbeats and requests."""
    codec = mavlink.MAVLink(None)
    messages = [codec.decode(bytearray(frame.data)) for frame in logged_frames(tlog.read_bytes())]
    return [m for m in messages if m.get_srcSystem() == STATION and m.get_type() not in UNRECORDED]

"""MAVLink 2 signing of complete frames (mavlink.io/en/guide/message_signing.html), as in ArduPilot.

Only messages advance the time stamp, which begins a minute after that of the key. ArduPilot's time stamp also
follows the date of the first GPS fix after a boot; that of the simulator does not.
"""

import hashlib
import hmac
import struct
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import HEADER_BYTES, MAVLINK2

TICKS_PER_S = 100_000  # a time stamp counts 10 us since the start of 2015
LAST_TIMESTAMP = 2**48 - 1  # largest time stamp in a signature
NEW_STREAM_AGE_TICKS = 60 * TICKS_PER_S  # largest age of the first message of a stream
KEY_LEAD_TICKS = 60 * TICKS_PER_S  # lead of the time stamp over that of a new key, against replays
MAX_STREAMS = 16
SIGNED = 0x01  # bit of the incompatibility flags, the third byte
SIGNATURE_BYTES = 13  # link id, time stamp of 6 bytes, 6 bytes of the hash
UNSIGNED_ALLOWED = frozenset({mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_RADIO})
NO_KEY = bytes(32)


class Signing:
    """One vehicle's key, time stamps and known streams; without a key, signing is off."""

    def __init__(self) -> None:
        self._key: bytes | None = None
        self._timestamp = 0  # latest time stamp sent or received
        self._streams: dict[tuple[int, int, int], int] = {}  # link, system, component -> latest time stamp

    @property
    def active(self) -> bool:
        """True while a key is set."""
        return self._key is not None

    def set_key(self, key: bytes, timestamp: int) -> None:
        """Set a key of 32 bytes and the present time stamp [10 us]; both zero: end signing.

        The lower 48 bits of the time stamp count. Raise ValueError if the key has another length.
        """
        if len(key) != len(NO_KEY):
            raise ValueError(f"a signing key has {len(NO_KEY)} bytes, found {len(key)}")
        self._key = None if key == NO_KEY and timestamp == 0 else key
        self._timestamp = min((timestamp & LAST_TIMESTAMP) + KEY_LEAD_TICKS, LAST_TIMESTAMP)

    def set_up(self, message: Any, *, armed: bool) -> bool:
        """Process SETUP_SIGNING; return False without a change if the vehicle is armed."""
        if not armed:
            self.set_key(bytes(message.secret_key), message.initial_timestamp)
        return not armed

    def reboot(self) -> None:
        """Forget the known streams; key and time stay."""
        self._streams.clear()

    def sign(self, frame: bytes, link_id: int) -> bytes:
        """Return an unsigned MAVLink 2 frame with a signature, or any other frame unchanged."""
        if self._key is None or not _is_unsigned_mavlink2(frame):
            return frame
        # A time stamp at its limit stays there, so receivers reject all later messages of the vehicle.
        self._timestamp = min(self._timestamp + 1, LAST_TIMESTAMP)
        (crc,) = struct.unpack("<H", frame[-2:])
        # The checksum is linear, so the bit SIGNED changes it by the checksum of this bit and zeros: one zero
        # for each later byte and for CRC_EXTRA, which need not be known.
        crc ^= mcrf4xx(bytes([SIGNED]) + bytes(len(frame) - 4), 0)
        covered = b"".join(
            (
                frame[:2],
                bytes([frame[2] | SIGNED]),
                frame[3:-2],
                struct.pack("<H", crc),
                struct.pack("<BQ", link_id & 0xFF, self._timestamp)[:7],
            )
        )
        return covered + self._hash(covered)

    def accepts(self, frame: bytes) -> bool:
        """Return True if a vehicle may obey a frame; the caller has verified the checksum."""
        if self._key is None:
            return True
        signed = frame[0] == MAVLINK2 and bool(frame[2] & SIGNED)
        return (signed and self._verified(frame)) or _message_id(frame) in UNSIGNED_ALLOWED

    def _verified(self, frame: bytes) -> bool:
        if not hmac.compare_digest(self._hash(frame[:-6]), frame[-6:]):
            return False
        stream = (frame[-SIGNATURE_BYTES], frame[5], frame[6])  # link, system, component
        timestamp = int.from_bytes(frame[-12:-6], "little")
        last = self._streams.get(stream)
        if last is None:
            if len(self._streams) >= MAX_STREAMS or timestamp + NEW_STREAM_AGE_TICKS < self._timestamp:
                return False
        elif timestamp <= last:
            return False
        self._streams[stream] = timestamp
        self._timestamp = max(self._timestamp, timestamp)
        return True

    def _hash(self, covered: bytes) -> bytes:
        assert self._key is not None
        return hashlib.sha256(self._key + covered).digest()[:6]


def _is_unsigned_mavlink2(frame: bytes) -> bool:
    return len(frame) >= HEADER_BYTES[MAVLINK2] + 2 and frame[0] == MAVLINK2 and not frame[2] & SIGNED


def _message_id(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little") if frame[0] == MAVLINK2 else frame[5]

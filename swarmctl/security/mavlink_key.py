"""Files of MAVLink signing: the key, and a timestamp that no used timestamp exceeds."""

from __future__ import annotations

import base64
import fcntl
import hashlib
import os
import re
from pathlib import Path

from swarmctl.security.files import KeyringError, check_private

KEY_BYTES = 32
"""https://mavlink.io/en/guide/message_signing.html#secret_key"""

PASSPHRASE = "passphrase:"
_HEX = re.compile(r"[0-9a-fA-F]{64}")
_FORMS = (
    "64 hexadecimal digits, the 44 characters in base64 that Mission Planner shows, or `passphrase: WORDS`, "
    "whose SHA-256 is the key as in Mission Planner and MAVProxy"
)


def read_mavlink_key(path: Path) -> bytes:
    """Return the key (32 bytes). Raises KeyringError, also if other users can read the file."""
    try:
        text = path.read_text(encoding="utf-8").strip()
    except OSError as error:
        where = "" if path.is_absolute() else f"; {path} is relative to the working directory"
        raise KeyringError(
            f"{path.absolute()}: the signing key cannot be read: {error.strerror or error}{where}"
        ) from error
    except UnicodeDecodeError as error:
        raise KeyringError(
            f"{path}: the signing key cannot be read: the file is not text; expected {_FORMS}"
        ) from error
    check_private(path)
    key = _parse_key(text)
    if key is None:
        raise KeyringError(f"{path}: found no signing key, expected {_FORMS}")
    if not any(key):
        raise KeyringError(
            f"{path}: a key of zeros turns signing off; make another key, or remove the option"
        )
    return key


def _parse_key(text: str) -> bytes | None:
    if text.startswith(PASSPHRASE):
        passphrase = text.removeprefix(PASSPHRASE).strip()
        return hashlib.sha256(passphrase.encode()).digest() if passphrase else None
    if _HEX.fullmatch(text):
        return bytes.fromhex(text)
    try:
        key = base64.b64decode(text, validate=True)
    except ValueError:
        return None
    return key if len(key) == KEY_BYTES else None


class TimestampFile:
    """File beside the key; its timestamp is at least as high as all used timestamps."""

    def __init__(self, key_file: Path) -> None:
        self.path = key_file.with_name(f"{key_file.name}.timestamp")

    def load(self) -> int:
        """Return the timestamp; 0 if there is no file. Raises OSError, and ValueError for an invalid file."""
        try:
            text = self.path.read_text(encoding="ascii")
        except FileNotFoundError:
            return 0
        return _parse_timestamp(text, self.path)

    def save(self, timestamp: int) -> None:
        """Store a timestamp, unless the file has a higher timestamp. Raises OSError and ValueError."""
        with os.fdopen(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o600), "r+", encoding="ascii") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            text = file.read()
            highest = max(timestamp, _parse_timestamp(text, self.path) if text else 0)
            file.seek(0)
            # The width is constant, so a crash cannot leave digits of a longer number.
            file.write(f"{highest:020d}\n")
            file.flush()
            os.fsync(file.fileno())


def _parse_timestamp(text: str, path: Path) -> int:
    if not text.strip().isdecimal():
        raise ValueError(
            f"{path}: found {text[:40]!r}, expected a number written by this program; restore the file"
        )
    return int(text)

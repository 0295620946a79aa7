"""The token of a flight: a secret that authenticates requests where the swarm has no keys.

Each flight, and each agent without keys, has a token. By default it is random, and only in the process's
file in the user's folder of running swarms (`swarmctl.bus.directory`). The environment variable
SWARMCTL_TOKEN_FILE names a file with a token, for processes of several users or machines.
"""

from __future__ import annotations

import hmac
import os
import secrets
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from swarmctl.security.files import KeyringError

TOKEN_FILE = "SWARMCTL_TOKEN_FILE"
RANDOM_BYTES = 32
MIN_CHARS, MAX_CHARS = 32, 200
"""limits on the length of a token; `openssl rand -hex 32` makes 64 characters"""


@dataclass(frozen=True, slots=True)
class Token:
    """A shared secret, as text."""

    text: str = field(repr=False)

    def sign(self, data: bytes) -> bytes:
        """Return the HMAC-SHA512 of data, as long as an Ed25519 signature."""
        return hmac.digest(self.text.encode(), data, "sha512")

    def verify(self, signature: bytes, data: bytes) -> bool:
        return hmac.compare_digest(signature, self.sign(data))


def new_token() -> Token:
    return Token(secrets.token_urlsafe(RANDOM_BYTES))


def token_of_environment(environment: Mapping[str, str] = os.environ) -> Token | None:
    """Return the token in the file that SWARMCTL_TOKEN_FILE names; None without it. Raises KeyringError."""
    name = environment.get(TOKEN_FILE, "")
    return read_token(Path(name)) if name else None


def read_token(path: Path) -> Token:
    """Return the token in a file of this user that no other user can read. Raises KeyringError."""
    where = f"{TOKEN_FILE}: {path}"
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                raise KeyringError(f"{where}: expected a file [token-file]")
            if found.st_uid != os.getuid():
                raise KeyringError(f"{where} belongs to another user; make a copy of your own [token-file]")
            mode = stat.S_IMODE(found.st_mode)
            if mode & 0o077:
                raise KeyringError(
                    f"{where} is open to other users (mode {mode:04o}); they may know the token: make a new "
                    "one, and run chmod 600 [token-file]"
                )
            text = file.read(MAX_CHARS + 2).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "expected printable ASCII"
        raise KeyringError(
            f"{where}: {reason}; expected a file, and no symbolic link, as `openssl rand -hex 32` writes it "
            "[token-file]"
        ) from error
    if not (MIN_CHARS <= len(text) <= MAX_CHARS and text.isprintable() and " " not in text):
        raise KeyringError(
            f"{where}: found {len(text)} characters, expected one line of {MIN_CHARS} to {MAX_CHARS} without "
            "spaces; make it with `openssl rand -hex 32` [token-file]"
        )
    return Token(text)

"""Keys of one participant, loaded on its machine, and checks of all folders on a machine."""

from __future__ import annotations

import contextlib
import datetime as dt
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from swarmctl.bus.transports.access import OPERATOR, name_of
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.security.files import (
    AUTHORITY,
    KeyringError,
    check_issuer,
    check_key_pair,
    check_name,
    check_private,
    check_validity,
    read,
    read_certificate,
    read_public_keys,
    read_signing_key,
)
from swarmctl.security.revocation import check_not_revoked, common_name, read_revoked

LOOK_EVERY_S = 1.0
"""time between looks at the table of public keys"""


@dataclass(slots=True)
class PublicKeyTable:
    """The public keys of all participants, read again after a change of their file.

    So agents in flight refuse a revoked key as soon as the new file is there. A file that cannot be read
    changes nothing.
    """

    path: Path
    keys: Mapping[str, Ed25519PublicKey]
    _file: tuple[int, ...] = ()
    """inode, size and time of the file that has `keys`"""
    _next_look_s: float = 0.0

    def current(self) -> Mapping[str, Ed25519PublicKey]:
        now_s = time.monotonic()
        if now_s >= self._next_look_s:
            self._next_look_s = now_s + LOOK_EVERY_S
            with contextlib.suppress(OSError, KeyringError):
                found = self.path.stat()
                file = (found.st_ino, found.st_size, found.st_mtime_ns)
                if file != self._file:
                    self.keys, self._file = read_public_keys(self.path), file
        return self.keys


class Keyring(msgspec.Struct, frozen=True):
    """One participant's keys."""

    name: str
    credentials: Credentials
    until: dt.datetime
    """end of the certificate's validity"""
    signing_key: Ed25519PrivateKey
    table: PublicKeyTable

    @property
    def public_keys(self) -> Mapping[str, Ed25519PublicKey]:
        """The public keys of all participants, as the file has them now."""
        return self.table.current()

    def sign(self, uav: int, data: bytes) -> bytes | None:
        """Return a signature (64 bytes); None if the keyring does not belong to vehicle `uav`."""
        return self.signing_key.sign(data) if name_of(uav) == self.name else None

    def verify(self, uav: int, signature: bytes, data: bytes) -> bool:
        """Return whether vehicle `uav` signed `data`."""
        return self._is_signed_by(name_of(uav), signature, data)

    def is_signed_by_operator(self, signature: bytes, data: bytes) -> bool:
        """Return whether the operator signed `data`."""
        return self._is_signed_by(OPERATOR, signature, data)

    def _is_signed_by(self, name: str, signature: bytes, data: bytes) -> bool:
        public_key = self.public_keys.get(name)
        if public_key is None:
            return False
        try:
            public_key.verify(signature, data)
        except InvalidSignature:
            return False
        return True


def load_keyring(folder: Path, name: str, now: dt.datetime) -> Keyring:
    """Load and check the keys of participant `name` at `now` (an aware datetime).

    Raises KeyringError.
    """
    own_folder = folder / name
    if not own_folder.is_dir():
        raise KeyringError(
            f"{own_folder}: no such folder; make it with `swarmctl keys --out {folder}`, or copy it from the "
            "machine where `swarmctl keys` ran"
        )
    revoked = read_revoked(own_folder)
    files = Credentials(
        own_folder / "ca.pem",
        own_folder / "cert.pem",
        own_folder / "key.pem",
        {participant: common_name(participant, revoked) for participant in revoked},
    )
    signing_key_file, public_keys_file = own_folder / "sign.pem", own_folder / "signers.json"
    ca, certificate = read_certificate(files.ca), read_certificate(files.certificate)
    check_not_revoked(files.certificate, certificate.serial_number, name, revoked)
    check_name(files.certificate, certificate, common_name(name, revoked))
    check_issuer(files.certificate, certificate, ca, files.ca)
    check_validity(files.ca, ca, now)
    check_validity(files.certificate, certificate, now)
    for private_file in (files.key, signing_key_file):
        check_private(private_file)
    check_key_pair(files.key, files.certificate, certificate)
    signing_key, public_keys = read_signing_key(signing_key_file), read_public_keys(public_keys_file)
    if public_keys.get(name) != signing_key.public_key():
        raise KeyringError(
            f"the key of {name} in {public_keys_file} does not belong to {signing_key_file}: other "
            f"participants would refuse messages of {name}; copy the whole folder from the machine where "
            "`swarmctl keys` ran"
        )
    table = PublicKeyTable(public_keys_file, public_keys)
    return Keyring(name, files, certificate.not_valid_after_utc, signing_key, table)


def find_problems(folder: Path, names: Sequence[str], now: dt.datetime) -> Iterator[str]:
    """Yield a line for each problem with the keys of the participants `names` at `now`.

    On the machine with the authority all folders are expected, on other machines at least one folder.
    """
    present = [name for name in names if (folder / name).is_dir()]
    has_authority = (folder / AUTHORITY).is_dir()
    authorities: dict[bytes, Path] = {}
    for name in names if has_authority or not present else present:
        try:
            load_keyring(folder, name, now)
            file = folder / name / "ca.pem"
            authorities.setdefault(read(file), file)
        except KeyringError as error:
            yield str(error)
        if not present:
            return  # one line for all missing folders
    if has_authority and present:
        file = folder / AUTHORITY / "ca.pem"
        try:
            authorities.setdefault(read(file), file)
        except KeyringError as error:
            yield str(error)
    if len(authorities) > 1:
        files = ", ".join(map(str, authorities.values()))
        yield (
            f"{files} belong to different authorities, so the participants refuse each other's connections: "
            "copy the folders of one `swarmctl keys --out` folder to all machines"
        )

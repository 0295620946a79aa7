"""Revocation of participants' keys, and the swarms of a folder of keys.

`revoked.json`, beside the folders and in each of them, lists the revoked certificates and signing keys by
participant. Revocation works in two ways:

- The table of public keys (`signers.json`) no longer has the revoked key, so its signatures are refused.
  Running agents read a new table within a second.
- Zenoh (1.10) knows no revocation lists. So a certificate made after a revocation has another common name,
  such as `uav3-2`, and access lists name only the last one.
"""

from __future__ import annotations

import contextlib
import datetime as dt
from collections.abc import Mapping
from pathlib import Path

import msgspec

from swarmctl.security.files import (
    KeyringError,
    public_text,
    read,
    read_certificate,
    read_signing_key,
)

FILE_NAME = "revoked.json"
SWARMS_FILE = "swarms.json"
PARTICIPANT_FILES = ("ca.pem", "cert.pem", "key.pem", "sign.pem", "signers.json", FILE_NAME)


class RevokedKeys(msgspec.Struct, frozen=True):
    """The keys of a participant that were revoked together."""

    certificate: str
    """serial number of the certificate, hexadecimal"""
    key: str
    """public key of the signatures, in base64"""
    unix_s: float


Revoked = Mapping[str, tuple[RevokedKeys, ...]]
"""revoked keys by participant, the oldest first"""
_decoder = msgspec.json.Decoder(dict[str, tuple[RevokedKeys, ...]])
_swarms_decoder = msgspec.json.Decoder(list[str])


def read_revoked(folder: Path) -> Revoked:
    """Return the list in a folder; empty without a list. Raises KeyringError."""
    path = folder / FILE_NAME
    if not path.exists():
        return {}
    try:
        return _decoder.decode(read(path))
    except msgspec.DecodeError as error:
        raise KeyringError(f"{path} is not a list of revoked keys: {error}; restore it") from error


def common_name(name: str, revoked: Revoked) -> str:
    """Return the common name of a participant's valid certificate."""
    n_revoked = len(revoked.get(name, ()))
    return name if n_revoked == 0 else f"{name}-{n_revoked + 1}"


def check_not_revoked(path: Path, serial_number: int, name: str, revoked: Revoked) -> None:
    """Raise KeyringError if the certificate of participant `name` is on the list."""
    if any(entry.certificate == f"{serial_number:x}" for entry in revoked.get(name, ())):
        raise KeyringError(
            f"{path} was revoked; copy the new folder of {name} from the machine where `swarmctl keys` ran "
            "[certificate-revoked]"
        )


def revoked_at(folder: Path, name: str, key: str) -> dt.datetime | None:
    """Return when the public signing `key` (base64) of `name` was revoked; None if it was not.

    Raises KeyringError.
    """
    times = [entry.unix_s for entry in read_revoked(folder).get(name, ()) if entry.key == key]
    return dt.datetime.fromtimestamp(times[0], dt.UTC) if times else None


def with_revoked(folder: Path, name: str, now: dt.datetime) -> Revoked:
    """Return the list of `folder` with the present keys of participant `name` added. Raises KeyringError."""
    own = folder / name
    if not own.is_dir():
        raise KeyringError(
            f"{own}: no such folder, so {name} has no keys to revoke; check name and --out. After an "
            "interrupted revocation, run `swarmctl keys` without --revoke"
        )
    serial = f"{read_certificate(own / 'cert.pem').serial_number:x}"
    revoked = read_revoked(folder)
    keys = RevokedKeys(serial, public_text(read_signing_key(own / "sign.pem")), now.timestamp())
    earlier = revoked.get(name, ())
    if any(entry.certificate == serial for entry in earlier):  # an interrupted revocation
        return revoked
    return {**revoked, name: (*earlier, keys)}


def remove_keys(own_folder: Path, n_revoked: int) -> None:
    """Remove a participant's keys, so that new ones are made. Raises OSError.

    The folder is renamed first, so that an interruption leaves no half folder. Files that `swarmctl keys` did
    not make stay in the renamed folder.
    """
    old = own_folder.rename(own_folder.with_name(f"{own_folder.name}-revoked-{n_revoked}"))
    for file in PARTICIPANT_FILES:
        (old / file).unlink(missing_ok=True)
    with contextlib.suppress(OSError):
        old.rmdir()


def swarms_with(authority_folder: Path, swarm: str, *, share: bool) -> bytes | None:
    """Return the list of the swarms that use an authority, with `swarm` added; None if it is on the list.

    Raises KeyringError for a second swarm, unless `share`: it would share vehicles, operator and router.
    """
    path = authority_folder / SWARMS_FILE
    if not path.exists():
        return msgspec.json.encode([swarm])
    try:
        swarms = _swarms_decoder.decode(read(path))
    except msgspec.DecodeError as error:
        raise KeyringError(f"{path} is not a list of swarms: {error}; restore it") from error
    if swarm in swarms:
        return None
    if not share:
        raise KeyringError(
            f"{authority_folder.parent} has the keys of {', '.join(swarms)}; {swarm} would get the same keys "
            "for vehicles, operator and router; give another folder with --out, or --share if both swarms "
            "are the same machines [keys-of-another-swarm]"
        )
    return msgspec.json.encode([*swarms, swarm])

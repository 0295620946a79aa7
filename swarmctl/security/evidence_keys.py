"""Signatures of a run's evidence: signing and checking."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from swarmctl.bus.transports.access import OPERATOR, name_of
from swarmctl.security.files import (
    PARTICIPANT_NAME,
    KeyringError,
    check_private,
    public_text,
    read_public_keys,
    read_signing_key,
)
from swarmctl.security.revocation import revoked_at


class EvidenceSigner(msgspec.Struct, frozen=True):
    """The signing key of one participant."""

    name: str
    signing_key: Ed25519PrivateKey

    @property
    def public_key(self) -> str:
        return public_text(self.signing_key)

    def sign(self, data: bytes) -> str:
        return base64.b64encode(self.signing_key.sign(data)).decode()


def load_evidence_signer(folder: Path, name: str) -> EvidenceSigner:
    """Return the signer of participant `name` in a folder of `swarmctl keys`. Raises KeyringError."""
    file = folder / name / "sign.pem"
    check_private(file)
    return EvidenceSigner(name, read_signing_key(file))


def operator_evidence_signer(keys: str | None) -> EvidenceSigner | None:
    """Return the operator's signer; None if the folder `keys` has no key of the operator.

    Raises KeyringError if the key exists and cannot be used.
    """
    if keys is None or not (Path(keys) / OPERATOR / "sign.pem").exists():
        return None
    return load_evidence_signer(Path(keys), OPERATOR)


def is_valid_signature(data: bytes, key: str, signature: str) -> bool:
    """Return whether the public `key` (base64) verifies `signature` (base64) of `data`."""
    try:
        public = Ed25519PublicKey.from_public_bytes(base64.b64decode(key, validate=True))
        public.verify(base64.b64decode(signature, validate=True), data)
    except (ValueError, InvalidSignature):
        return False
    return True


def signer_trouble(by: str, vehicles: Mapping[str, int], mentioned: Iterable[str]) -> str:
    """Return why participant `by` cannot have written the evidence of a run; empty if it can.

    vehicles: system ids of the run's vehicles, by name
    mentioned: names of the vehicles in the entries
    """
    if by == OPERATOR:
        return ""
    names = ", ".join(f"{name} (system {sysid})" for name, sysid in vehicles.items())
    if [name_of(sysid) for sysid in vehicles.values()] != [by]:
        return (
            f"the run is of {names or 'no named vehicle'}, so only their own agent or the operator signs it"
        )
    others = {name for name in vehicles if PARTICIPANT_NAME.fullmatch(name)} - {by}
    others |= {name for name in mentioned if name not in vehicles and not name.startswith("system ")}
    if others:
        return f"the entries are about {', '.join(sorted(others))}, but {by} flies {names}"
    return ""


def key_trouble(folder: Path, name: str, key: str) -> str:
    """Return why the public `key` (base64) is no valid key of `name` in `folder`; empty if it is one.

    The text ends in a code. Raises KeyringError.
    """
    # All participants of a swarm have the same table.
    tables = sorted(folder.glob("*/signers.json"))
    if not tables:
        raise KeyringError(
            f"{folder}: no subfolder has a signers.json; give a folder made by `swarmctl keys`"
        )
    listed_key = read_public_keys(tables[0]).get(name)
    if listed_key is not None and public_text(listed_key) == key:
        return ""
    if (at := revoked_at(tables[0].parent, name, key)) is not None:
        return (
            f"this key was revoked at {at:%Y-%m-%d %H:%M} UTC, so others may have written the evidence "
            "[signed-with-revoked-key]"
        )
    return f"{folder} has no such key of {name} [signed-with-other-key]"

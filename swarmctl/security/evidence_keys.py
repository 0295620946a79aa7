"""Signatures under a run's evidence: whose they are, and whether they hold."""

from __future__ import annotations

import base64
import binascii
from dataclasses import dataclass
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from swarmctl.security.files import KeyringError, must_be_private, read_signer, read_signers


@dataclass(frozen=True, slots=True)
class Witness:
    """Signs as one participant."""

    name: str
    signer: Ed25519PrivateKey

    @property
    def public_key(self) -> str:
        return base64.b64encode(self.signer.public_key().public_bytes_raw()).decode()

    def sign(self, data: bytes) -> str:
        return base64.b64encode(self.signer.sign(data)).decode()


def witness(folder: Path, name: str) -> Witness:
    """With the key of participant `name` in a folder that `swarmctl keys` made. Raises KeyringError."""
    file = folder / name / "sign.pem"
    must_be_private(file)
    return Witness(name, read_signer(file))


def holds(data: bytes, key: str, signature: str) -> bool:
    """Whether the owner of the public `key` has signed `data`; both in base64, of any content."""
    try:
        public = Ed25519PublicKey.from_public_bytes(base64.b64decode(key, validate=True))
        public.verify(base64.b64decode(signature, validate=True), data)
    except (ValueError, TypeError, binascii.Error, InvalidSignature):
        return False
    return True


def is_key_of(folder: Path, name: str, key: str) -> bool:
    """Whether the keyring in `folder` has this public key (base64) for `name`. Raises KeyringError."""
    tables = sorted(folder.glob("*/signers.json"))
    if not tables:
        raise KeyringError(
            f"{folder}: no signers.json in any folder there; expected a folder that `swarmctl keys` made"
        )
    known = read_signers(tables[0]).get(name)
    return known is not None and base64.b64encode(known.public_bytes_raw()).decode() == key

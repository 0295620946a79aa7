"""One participant's folder, as its machine uses it."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from swarmctl.bus.transports.access import OPERATOR, name_of
from swarmctl.bus.transports.zenoh_config import Credentials
from swarmctl.security.files import (
    KeyringError,
    must_be_issued_by,
    must_be_private,
    must_be_valid,
    must_fit,
    must_name,
    read_certificate,
    read_signer,
    read_signers,
)


@dataclass(frozen=True, slots=True)
class Keyring:
    """One participant's keys."""

    name: str
    credentials: Credentials
    until: dt.datetime
    signer: Ed25519PrivateKey
    signers: Mapping[str, Ed25519PublicKey]

    def sign(self, uav: int, data: bytes) -> bytes | None:
        """64 bytes; None for another vehicle than this keyring's."""
        return self.signer.sign(data) if name_of(uav) == self.name else None

    def verify(self, uav: int, signature: bytes, data: bytes) -> bool:
        """Whether vehicle `uav` signed `data`."""
        return self._is_signed_by(name_of(uav), signature, data)

    def is_operators(self, signature: bytes, data: bytes) -> bool:
        """Whether the operator signed `data`."""
        return self._is_signed_by(OPERATOR, signature, data)

    def _is_signed_by(self, name: str, signature: bytes, data: bytes) -> bool:
        signer = self.signers.get(name)
        if signer is None:
            return False
        try:
            signer.verify(signature, data)
        except InvalidSignature:
            return False
        return True


def load(folder: Path, name: str, now: dt.datetime) -> Keyring:
    """What `folder` holds for participant `name`, whole and valid at `now` (an aware datetime).

    Raises KeyringError.
    """
    own = folder / name
    if not own.is_dir():
        raise KeyringError(
            f"{own}: no such folder; `swarmctl keys --out {folder}` makes it, or copy it from where that was "
            "done"
        )
    files = Credentials(own / "ca.pem", own / "cert.pem", own / "key.pem")
    ca, certificate = read_certificate(files.ca), read_certificate(files.certificate)
    must_name(files.certificate, certificate, name)
    must_be_issued_by(files.certificate, certificate, ca, files.ca)
    must_be_valid(files.ca, ca, now)
    must_be_valid(files.certificate, certificate, now)
    for private in (files.key, own / "sign.pem"):
        must_be_private(private)
    must_fit(files.key, files.certificate, certificate)
    signer, signers = read_signer(own / "sign.pem"), read_signers(own / "signers.json")
    if signers.get(name) != signer.public_key():
        raise KeyringError(
            f"{own / 'signers.json'} has another key for {name} than {own / 'sign.pem'}: others would "
            "refuse what it says; copy the folder whole from where `swarmctl keys` made it"
        )
    return Keyring(name, files, certificate.not_valid_after_utc, signer, signers)

"""Files of a keyring: readers and checks."""

from __future__ import annotations

import base64
import datetime as dt
import re
import stat
from collections.abc import Mapping
from pathlib import Path

import msgspec
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.x509.oid import NameOID

AUTHORITY = "ca"
"""folder of the certificate authority"""
_COPY_AGAIN = "copy the whole folder again from the machine where `swarmctl keys` ran"
PARTICIPANT_NAME = re.compile(r"uav[1-9][0-9]{0,2}|operator|router")
"""valid names of participants; the pattern also takes uav255 to uav999"""


class KeyringError(Exception):
    """A fault of keys or their folder, or an invalid name of a participant or host."""


def read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise KeyringError(f"{path}: {error.strerror or error}; {_COPY_AGAIN}") from error


def read_certificate(path: Path) -> x509.Certificate:
    content = read(path)
    try:
        return x509.load_pem_x509_certificate(content)
    except ValueError as error:
        raise KeyringError(f"{path} is not a certificate in PEM; restore it, or make it again") from error


def read_private(path: Path) -> object:
    content = read(path)
    try:
        return serialization.load_pem_private_key(content, password=None)
    except (ValueError, TypeError) as error:
        raise KeyringError(f"{path} is not a private key in PEM without a password; restore it") from error


def read_ec_key(path: Path) -> ec.EllipticCurvePrivateKey:
    key = read_private(path)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise KeyringError(f"{path} is not a key on an elliptic curve; restore it, or make it again")
    return key


def read_signing_key(path: Path) -> Ed25519PrivateKey:
    key = read_private(path)
    if not isinstance(key, Ed25519PrivateKey):
        raise KeyringError(f"{path} is not an Ed25519 key; restore it, or make it again")
    return key


_public_keys = msgspec.json.Decoder(dict[str, bytes])


def read_public_keys(path: Path) -> dict[str, Ed25519PublicKey]:
    content = read(path)
    try:
        table = _public_keys.decode(content)
        return {name: Ed25519PublicKey.from_public_bytes(key) for name, key in table.items()}
    except ValueError as error:
        raise KeyringError(f"{path} is not a table of public keys: {error}; restore it") from error


def encode_table(table: Mapping[str, object]) -> bytes:
    """Return a table as indented JSON, with bytes in base64."""
    return msgspec.json.format(msgspec.json.encode(table), indent=2) + b"\n"


def public_text(key: Ed25519PrivateKey | Ed25519PublicKey) -> str:
    """Return the public key in base64."""
    public = key.public_key() if isinstance(key, Ed25519PrivateKey) else key
    return base64.b64encode(public.public_bytes_raw()).decode()


def check_name(path: Path, certificate: x509.Certificate, name: str) -> None:
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if [attribute.value for attribute in names] != [name]:
        raise KeyringError(
            f"{path} is not the certificate of {name}; remove {path.parent}, or give another folder of keys"
        )


def check_issuer(
    path: Path, certificate: x509.Certificate, authority: x509.Certificate, folder: Path
) -> None:
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise KeyringError(
            f"{path} was not issued by the authority of {folder}, so it belongs to another swarm; remove the "
            "file, or give another folder"
        ) from error


def check_validity(path: Path, certificate: x509.Certificate, now: dt.datetime) -> None:
    if now > certificate.not_valid_after_utc:
        raise KeyringError(
            f"{path} was valid until {certificate.not_valid_after_utc:%Y-%m-%d %H:%M} UTC; remove the folder "
            "and make it again with `swarmctl keys` [certificate-expired]"
        )
    if now < certificate.not_valid_before_utc:
        raise KeyringError(
            f"{path} is valid from {certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC on, but this "
            f"machine's clock shows {now:%Y-%m-%d %H:%M} UTC; set the clock"
        )


def check_key_pair(key_file: Path, certificate_file: Path, certificate: x509.Certificate) -> None:
    if read_ec_key(key_file).public_key() != certificate.public_key():
        raise KeyringError(
            f"{key_file} is not the key of {certificate_file}; restore both, or make them again"
        )


def check_private(path: Path) -> None:
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
    except OSError as error:
        raise KeyringError(f"{path}: {error.strerror or error}; {_COPY_AGAIN}") from error
    if mode & 0o077:
        raise KeyringError(f"{path} is open to other users (mode {mode:04o}); run chmod 600 {path}")


def hosts_of(certificate: x509.Certificate) -> tuple[str, ...]:
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    return tuple(str(name.value) for name in names)

"""Creation of the participants' key folders and of their certificate authority; existing keys are kept."""

from __future__ import annotations

import datetime as dt
import ipaddress
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from swarmctl.core.records import replace
from swarmctl.core.whole_file import write_whole
from swarmctl.security.files import (
    AUTHORITY,
    PARTICIPANT_NAME,
    KeyringError,
    check_issuer,
    check_key_pair,
    check_name,
    check_validity,
    encode_table,
    hosts_of,
    read_certificate,
    read_ec_key,
    read_signing_key,
)
from swarmctl.security.revocation import (
    FILE_NAME,
    SWARMS_FILE,
    Revoked,
    check_not_revoked,
    common_name,
    read_revoked,
    remove_keys,
    swarms_with,
    with_revoked,
)

LOCAL_HOSTS = ("localhost", "127.0.0.1")
BACKDATED_BY = dt.timedelta(days=1)
"""time from the start of a certificate's validity to its issue, because companions' clocks may be late"""
PRIVATE_MODE = 0o600


class ParticipantFolder(msgspec.Struct, frozen=True):
    """A participant's folder, and the end of its certificate's validity."""

    name: str
    folder: Path
    is_new: bool
    is_changed: bool
    """True for an existing folder whose table of public keys changed; its machine needs a new copy"""
    until: dt.datetime
    hosts: tuple[str, ...]


def make_keys(
    folder: Path,
    names: Sequence[str],
    days: int,
    now: dt.datetime,
    hosts: Mapping[str, Sequence[str]] | None = None,
    *,
    swarm: str | None = None,
    share: bool = False,
    revoke: Sequence[str] = (),
) -> list[ParticipantFolder]:
    """Make the missing folders of the participants `names`, and check the existing folders.

    days: validity of new certificates after `now` (an aware datetime); ten times that of a new authority
    hosts: participant's name -> hosts beside LOCAL_HOSTS
    swarm: name of the swarm; another swarm's folder is refused, unless `share`
    revoke: participants whose present keys are revoked and made anew

    Raises KeyringError.
    """
    for name in (*names, *revoke):
        if not PARTICIPANT_NAME.fullmatch(name):
            raise KeyringError(f"{name!r} is not a participant: expected uav1 to uav254, operator or router")
    hosts = dict(hosts or {})
    try:
        authority = _authority(folder / AUTHORITY, days, now)
        if swarm is not None and (swarms := swarms_with(folder / AUTHORITY, swarm, share=share)):
            _write(folder / AUTHORITY / SWARMS_FILE, swarms)
        for name in revoke:
            # The list first: an interrupted revocation is completed by the next one.
            revoked = with_revoked(folder, name, now)
            _write(folder / FILE_NAME, encode_table(revoked))
            hosts[name] = (*hosts.get(name, ()), *hosts_of(read_certificate(folder / name / "cert.pem")))
            remove_keys(folder / name, len(revoked[name]))
        revoked = read_revoked(folder)
        folders = [
            _participant(folder / name, name, authority, days, now, hosts.get(name, ()), revoked)
            for name in names
        ]
        changed = _distribute(folder, revoked)
    except OSError as error:
        raise KeyringError(f"{error.filename or folder}: {error.strerror or error}") from error
    return [replace(item, is_changed=not item.is_new and item.name in changed) for item in folders]


class _Authority(msgspec.Struct, frozen=True):
    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate


def _authority(folder: Path, days: int, now: dt.datetime) -> _Authority:
    certificate_file, key_file = folder / "ca.pem", folder / "key.pem"
    if not folder.exists():
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "swarmctl")])
        usage = _usage(signs_certificates=True)
        certificate = (
            _builder(name, name, key.public_key(), now, 10 * days)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .sign(key, hashes.SHA256())
        )
        _write(certificate_file, certificate.public_bytes(serialization.Encoding.PEM))
        _write_key(key_file, key)
        return _Authority(key, certificate)
    existing = _Authority(read_ec_key(key_file), read_certificate(certificate_file))
    if existing.key.public_key() != existing.certificate.public_key():
        raise KeyringError(
            f"{key_file} is not the key of {certificate_file}; restore both, or give another folder"
        )
    check_validity(certificate_file, existing.certificate, now)
    return existing


def _participant(
    folder: Path,
    name: str,
    authority: _Authority,
    days: int,
    now: dt.datetime,
    hosts: Sequence[str],
    revoked: Revoked,
) -> ParticipantFolder:
    if folder.exists():
        return _check_existing(folder, name, authority, now, hosts, revoked)
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name(name, revoked))])
    all_hosts = tuple(dict.fromkeys((name, *LOCAL_HOSTS, *hosts)))
    purposes = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    certificate = (
        _builder(subject, authority.certificate.subject, key.public_key(), now, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        .add_extension(x509.SubjectAlternativeName(_general_names(all_hosts)), critical=False)
        .sign(authority.key, hashes.SHA256())
    )
    _write(folder / "ca.pem", authority.certificate.public_bytes(serialization.Encoding.PEM))
    _write(folder / "cert.pem", certificate.public_bytes(serialization.Encoding.PEM))
    _write_key(folder / "key.pem", key)
    _write_key(folder / "sign.pem", Ed25519PrivateKey.generate())
    return ParticipantFolder(name, folder, True, False, certificate.not_valid_after_utc, all_hosts)


def _check_existing(
    folder: Path,
    name: str,
    authority: _Authority,
    now: dt.datetime,
    hosts: Sequence[str],
    revoked: Revoked,
) -> ParticipantFolder:
    """Check an existing folder: name, authority, validity, keys and hosts; return the folder."""
    certificate_file = folder / "cert.pem"
    certificate = read_certificate(certificate_file)
    check_not_revoked(certificate_file, certificate.serial_number, name, revoked)
    check_name(certificate_file, certificate, common_name(name, revoked))
    check_issuer(certificate_file, certificate, authority.certificate, folder.parent / AUTHORITY)
    check_validity(certificate_file, certificate, now)
    check_key_pair(folder / "key.pem", certificate_file, certificate)
    read_signing_key(folder / "sign.pem")
    certified_hosts = hosts_of(certificate)
    if missing := [host for host in hosts if host not in certified_hosts]:
        raise KeyringError(
            f"{certificate_file} does not name {', '.join(missing)}; remove {folder}, so that the next "
            "`swarmctl keys` makes it again"
        )
    return ParticipantFolder(name, folder, False, False, certificate.not_valid_after_utc, certified_hosts)


def _distribute(folder: Path, revoked: Revoked) -> set[str]:
    """Write public keys and revoked keys into every folder, new or existing; return the changed folders."""
    folders = sorted(path for path in folder.iterdir() if PARTICIPANT_NAME.fullmatch(path.name))
    public = {
        path.name: read_signing_key(path / "sign.pem").public_key().public_bytes_raw() for path in folders
    }
    contents = {"signers.json": encode_table(public)}
    if revoked:
        contents[FILE_NAME] = encode_table(revoked)
    changed = [
        path / file
        for path in folders
        for file, content in contents.items()
        if not _has_content(path / file, content)
    ]
    for path in changed:
        _write(path, contents[path.name])
    return {path.parent.name for path in changed}


def _has_content(path: Path, content: bytes) -> bool:
    return path.exists() and path.read_bytes() == content


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, now: dt.datetime, days: int
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - BACKDATED_BY)
        .not_valid_after(now + dt.timedelta(days=days))
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _general_names(hosts: Iterable[str]) -> list[x509.GeneralName]:
    names: list[x509.GeneralName] = []
    for host in hosts:
        try:
            names.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            try:
                names.append(x509.DNSName(host))
            except ValueError as error:
                raise KeyringError(f"{host!r} is not a host: expected a name or an address") from error
    return names


def _write(path: Path, content: bytes, mode: int = 0o644) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    for draft in path.parent.glob(f".{path.name}.*.new"):  # a killed process may have left a private key
        draft.unlink(missing_ok=True)
    write_whole(path, content, mode)


def _write_key(path: Path, key: ec.EllipticCurvePrivateKey | Ed25519PrivateKey) -> None:
    pem = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    _write(path, pem, PRIVATE_MODE)

"""Keys of a fleet: a certificate authority of the site, and a certificate with a key for each chair, named after it.

With the authority's key anybody can add chairs: it stays on one computer, and never goes to a chair.
"""

from __future__ import annotations

import datetime
import os
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from waychair.errors import FleetError, MissingExtra
from waychair.files import os_error_text
from waychair.install_advice import install_command

AUTHORITY, AUTHORITY_KEY = "authority.pem", "authority.key"

VALID_DAYS, AUTHORITY_DAYS = 730, 3650
"""Days for which a chair's certificate and the authority's are valid."""

_EARLIER = datetime.timedelta(days=1)
"""A certificate is valid from a day before, for chairs whose clocks are behind."""


@dataclass(frozen=True, slots=True)
class KeyFiles:
    """The files that a peer needs: the authority's certificate, its own, and its own key."""

    authority: Path
    certificate: Path
    key: Path


def new_keys(folder: Path, name: str, days: int = VALID_DAYS) -> KeyFiles:
    """Write a key and a certificate for a name, by the folder's authority, which is made first if there is none.

    Raises:
        FleetError: there are keys of this name, the authority's key is missing, or the folder cannot be written.
        MissingExtra: the extra [fleet] is not installed.
    """
    _need_extra()
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    if not name.replace("-", "").replace("_", "").isalnum() or not name.isascii():
        raise FleetError(f"'{name}' is no name for keys: use letters and digits, such as chair2")
    files = KeyFiles(folder / AUTHORITY, folder / f"{name}.pem", folder / f"{name}.key")
    if files.certificate.exists() or files.key.exists():
        raise FleetError(f"{folder} has keys of {name} already: delete both files to make new ones")
    if files.authority.exists() != (folder / AUTHORITY_KEY).exists():
        raise FleetError(
            f"{folder} has half an authority: bring {AUTHORITY} and {AUTHORITY_KEY} together, or delete both"
        )

    def named(text: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    def signed(
        subject: str,
        issuer: x509.Name,
        key: ec.EllipticCurvePrivateKey,
        by: ec.EllipticCurvePrivateKey,
        is_authority: bool,
    ) -> x509.Certificate:
        now = datetime.datetime.now(datetime.UTC)
        until = now + datetime.timedelta(days=AUTHORITY_DAYS if is_authority else days)
        builder = (
            x509.CertificateBuilder()
            .subject_name(named(subject))
            .issuer_name(issuer)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(min(now - _EARLIER, until - _EARLIER))
            .not_valid_after(until)
            .add_extension(x509.BasicConstraints(ca=is_authority, path_length=None), critical=True)
        )
        if not is_authority:
            builder = builder.add_extension(x509.SubjectAlternativeName([x509.DNSName(subject)]), critical=False)
        return builder.sign(by, hashes.SHA256())

    def written(path: Path, data: bytes, mode: int) -> None:
        try:
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with os.fdopen(handle, "wb") as file:
                file.write(data)
        except OSError as error:
            raise FleetError(f"{path} cannot be written: {os_error_text(error)}; choose another folder") from None

    def key_text(key: ec.EllipticCurvePrivateKey) -> bytes:
        return key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FleetError(f"{folder} cannot be made: {os_error_text(error)}; choose another folder") from None
    if not files.authority.exists():
        root = ec.generate_private_key(ec.SECP256R1())
        title = f"waychair fleet {os.urandom(4).hex()}"
        certificate = signed(title, named(title), root, root, True)
        written(folder / AUTHORITY_KEY, key_text(root), 0o600)
        written(files.authority, certificate.public_bytes(serialization.Encoding.PEM), 0o644)
    try:
        known = serialization.load_pem_private_key((folder / AUTHORITY_KEY).read_bytes(), None)
        authority = x509.load_pem_x509_certificate(files.authority.read_bytes())
    except (OSError, ValueError):
        raise FleetError(f"the authority in {folder} is damaged: bring the files back, or make all keys anew") from None
    if not isinstance(known, ec.EllipticCurvePrivateKey):
        raise FleetError(f"the authority in {folder} is of another kind: make all keys anew in another folder")
    key = ec.generate_private_key(ec.SECP256R1())
    certificate = signed(name, authority.subject, key, known, False)
    written(files.key, key_text(key), 0o600)
    written(files.certificate, certificate.public_bytes(serialization.Encoding.PEM), 0o644)
    return files


def checked_keys(folder: Path, name: str) -> KeyFiles:
    """Return the key files of a name after a check that the network would accept them.

    Raises:
        FleetError: one is missing, damaged, expired, or of another authority or name; the message says which.
        MissingExtra: the extra [fleet] is not installed.
    """
    _need_extra()
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import NameOID

    files = KeyFiles(folder / AUTHORITY, folder / f"{name}.pem", folder / f"{name}.key")
    advice = f"make keys with `waychair fleet keys new {name}`"
    for path in (files.authority, files.certificate, files.key):
        if not path.is_file():
            raise FleetError(f"there is no {path}: {advice}, and copy {AUTHORITY}, {name}.pem and {name}.key")
    try:
        authority = x509.load_pem_x509_certificate(files.authority.read_bytes())
        certificate = x509.load_pem_x509_certificate(files.certificate.read_bytes())
        key = serialization.load_pem_private_key(files.key.read_bytes(), None)
    except (OSError, ValueError):
        raise FleetError(f"the keys of {name} in {folder} are damaged: {advice}") from None
    now = datetime.datetime.now(datetime.UTC)
    for each, what in ((certificate, f"the certificate of {name}"), (authority, "the authority's certificate")):
        if not each.not_valid_before_utc <= now <= each.not_valid_after_utc:
            until = each.not_valid_after_utc.date().isoformat()
            raise FleetError(
                f"{what} is valid until {until}, and it is {now.date().isoformat()}: {advice}, or set the clock"
            )
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        raise FleetError(f"the certificate of {name} is of another authority: {advice}") from None
    names = [str(each.value) for each in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
    if names != [name]:
        raise FleetError(f"{files.certificate} is the certificate of {', '.join(names)}, not of {name}: {advice}")
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise FleetError(f"{files.key} does not belong to {files.certificate}: {advice}")
    return files


def _need_extra() -> None:
    if find_spec("cryptography") is None:
        raise MissingExtra(f"keys need the extra [fleet]: {install_command('fleet')}")

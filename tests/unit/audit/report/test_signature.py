"""Signatures of the statement: DSSE's own example, both kinds of key, and what is refused."""

import base64
import json

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from socialiq.audit.report.folder import SIGNATURES, STATEMENT
from socialiq.audit.report.signature import (
    MOST_SIGNATURES,
    PASSPHRASE,
    PAYLOAD_TYPE,
    encoded,
    faults_of_signature,
    key_id,
    read_private_key,
    read_public_key,
    signed,
)
from socialiq.errors import UserError

TEXT = b'{"_type": "statement"}\n'


def made():
    return [Ed25519PrivateKey.generate(), ec.generate_private_key(ec.SECP256R1())]


def pem(key, encryption=None):
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, encryption or NoEncryption())


def public_pem(key):
    return key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


def faults(envelope, key, statement=TEXT):
    return faults_of_signature({STATEMENT: statement, SIGNATURES: envelope}, key.public_key())


def test_what_is_signed_is_that_of_the_specification():
    """The example of DSSE's protocol.md, version 1.0.0, with its key and its signature."""
    x = 46950820868899156662930047687818585632848591499744589407958293238635476079160
    y = 5640078356564379163099075877009565129882514886557779369047442380624545832820
    raw = base64.b64decode(
        "A3JqsQGtVsJ2O2xqrI5IcnXip5GToJ3F+FnZ+O88SjtR6rDAajabZKciJTfUiHqJPcIAriEGAHTVeCUjW2JIZA=="
    )
    body = encoded("http://example.com/HelloWorld", b"hello world")
    assert body == b"DSSEv1 29 http://example.com/HelloWorld 11 hello world"
    key = ec.EllipticCurvePublicNumbers(x, y, ec.SECP256R1()).public_key()
    signature = encode_dss_signature(int.from_bytes(raw[:32]), int.from_bytes(raw[32:]))
    key.verify(signature, body, ec.ECDSA(hashes.SHA256()))


def test_lengths_are_of_bytes():
    assert encoded("ä", b"\x00\xff") == b"DSSEv1 2 \xc3\xa4 2 \x00\xff"


@pytest.mark.parametrize("kind", [0, 1])
def test_a_signature_holds_for_its_key_and_its_statement(kind):
    key, other = made()[kind], made()[kind]
    envelope = signed(TEXT, key)
    content = json.loads(envelope)
    assert base64.b64decode(content["payload"]) == TEXT
    assert content["payloadType"] == PAYLOAD_TYPE
    assert [one["keyid"] for one in content["signatures"]] == [key_id(key.public_key())]
    assert faults(envelope, key) == []
    assert faults(envelope, other) == [
        f"no signature in {SIGNATURES} is by the key {key_id(other.public_key())}"
    ]
    (found,) = faults(envelope, key, TEXT + b" ")
    assert "of another statement" in found


def test_owner_and_auditor_may_both_sign():
    owner, auditor = made()
    both = signed(TEXT, auditor, signed(TEXT, owner))
    assert faults(both, owner) == faults(both, auditor) == []
    assert len(json.loads(signed(TEXT, owner, both))["signatures"]) == 2  # not three
    later = signed(b"another", owner, both)
    assert len(json.loads(later)["signatures"]) == 1
    assert faults(later, owner, b"another") == [] and faults(later, auditor, b"another") != []


def test_there_is_an_end_of_signatures():
    envelope = None
    for _ in range(MOST_SIGNATURES):
        envelope = signed(TEXT, Ed25519PrivateKey.generate(), envelope)
    with pytest.raises(UserError, match="signatures already"):
        signed(TEXT, Ed25519PrivateKey.generate(), envelope)


def test_the_id_of_a_key_proves_nothing():
    key, other = made()
    content = json.loads(signed(TEXT, other))
    content["signatures"][0]["keyid"] = key_id(key.public_key())
    assert faults(json.dumps(content).encode(), key) != []
    del content["signatures"][0]["keyid"]
    assert faults(json.dumps(content).encode(), other) == []


def test_either_alphabet_of_base64_is_read():
    key = made()[0]
    content = json.loads(signed(TEXT * 9, key))
    for place in (content, content["signatures"][0]):
        for name in {"payload", "sig"} & place.keys():
            place[name] = place[name].replace("+", "-").replace("/", "_")
    assert faults(json.dumps(content).encode(), key, TEXT * 9) == []


def test_a_folder_that_is_not_signed_is_said_to_be(tmp_path):
    found = faults_of_signature({STATEMENT: TEXT}, made()[0].public_key())
    assert found == [f"{SIGNATURES} is missing: no one has signed this folder"]


@pytest.mark.parametrize(
    "envelope",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff",
        b"[" * 100_000,
        b'{"payload": 1, "payloadType": "application/vnd.in-toto+json", "signatures": []}',
        b'{"payload": "%%", "payloadType": "application/vnd.in-toto+json", "signatures": []}',
        b'{"payload": "", "payloadType": "application/json", "signatures": []}',
        b'{"payload": "", "payloadType": "application/vnd.in-toto+json", "signatures": [1]}',
        b'{"payload": "", "payloadType": "application/vnd.in-toto+json", "signatures": [{}]}',
        b'{"payload": "", "payloadType": "application/vnd.in-toto+json", "signatures": 5}',
    ],
)
def test_what_is_no_envelope_is_a_fault(envelope):
    (found,) = faults(envelope, made()[0])
    assert "is not an envelope of a statement" in found


def test_an_empty_list_of_signatures_is_none():
    content = json.loads(signed(TEXT, made()[0])) | {"signatures": []}
    assert "no signature" in faults(json.dumps(content).encode(), made()[0])[0]


@pytest.mark.parametrize("kind", [0, 1])
def test_keys_read_back_from_pem(tmp_path, kind):
    key = made()[kind]
    (tmp_path / "private.pem").write_bytes(pem(key))
    (tmp_path / "public.pem").write_bytes(public_pem(key))
    envelope = signed(TEXT, read_private_key(tmp_path / "private.pem"))
    public = read_public_key(tmp_path / "public.pem")
    assert faults_of_signature({STATEMENT: TEXT, SIGNATURES: envelope}, public) == []
    assert key_id(public) == key_id(key.public_key())


def test_a_passphrase_opens_an_encrypted_key(tmp_path, monkeypatch):
    path, key = tmp_path / "private.pem", made()[0]
    path.write_bytes(pem(key, BestAvailableEncryption(b"sesame")))
    monkeypatch.delenv(PASSPHRASE, raising=False)
    with pytest.raises(UserError, match=f"put its passphrase into {PASSPHRASE}"):
        read_private_key(path)
    monkeypatch.setenv(PASSPHRASE, "wrong")
    with pytest.raises(UserError, match="is not its passphrase"):
        read_private_key(path)
    monkeypatch.setenv(PASSPHRASE, "sesame")
    assert pem(read_private_key(path)) == pem(key)
    path.write_bytes(pem(key))
    with pytest.raises(UserError, match=f"unset {PASSPHRASE}"):
        read_private_key(path)


def test_other_keys_are_refused_in_one_line(tmp_path):
    path = tmp_path / "key.pem"
    for key in (rsa.generate_private_key(65537, 2048), ec.generate_private_key(ec.SECP384R1())):
        path.write_bytes(pem(key))
        with pytest.raises(UserError, match="is a key of another kind"):
            read_private_key(path)
        path.write_bytes(public_pem(key))
        with pytest.raises(UserError, match="is a key of another kind"):
            read_public_key(path)
    path.write_bytes(pem(made()[0]))
    with pytest.raises(UserError, match="is not a public key in PEM"):
        read_public_key(path)
    path.write_bytes(public_pem(made()[0]))
    with pytest.raises(UserError, match="is not a private key in PEM"):
        read_private_key(path)
    for read in (read_public_key, read_private_key):
        path.write_bytes(b"\xff\x00")
        with pytest.raises(UserError, match="in PEM"):
            read(path)
        with pytest.raises(UserError, match="no such file"):
            read(tmp_path / "none.pem")

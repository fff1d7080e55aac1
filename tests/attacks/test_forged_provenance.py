"""Attack: who chose the seed, when, where and by which command are rewritten, and resealed.

These follow from no other file. It worked: `audit verify` called such a folder "as it was
written", and no page said that they are only the auditor's words.
"""

import json

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from socialiq.cli.main import main


def forge(report):
    report["timing"]["started"] = "2020-01-01T00:00:00+00:00"
    report["machine"] = "a laboratory of the authority"
    report["versions"] = {"python": "3.99"}
    report["command"] = "socialiq audit somebody-elses-policy"


@pytest.fixture
def keys(tmp_path):
    """Paths of an auditor's private and public key."""
    key, made = Ed25519PrivateKey.generate(), []
    for name, text in (
        ("private.pem", key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )),
        ("public.pem", key.public_key().public_bytes(
            serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
        )),
    ):  # fmt: skip
        (tmp_path / name).write_bytes(text)
        made.append(str(tmp_path / name))
    return made


def test_they_are_said_to_be_claims(passed, reseal, tmp_path, capsys):
    copy = reseal(passed, tmp_path / "forged", forge)
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 0
    said = capsys.readouterr().out
    assert "as it was written" not in said
    (line,) = [one for one in said.splitlines() if one.startswith("left to believe")]
    for name in ("timing", "machine", "versions", "command"):
        assert name in line
    page = (copy / "report.html").read_text()
    _, _, claims = page.partition("Claims of the auditor")
    assert "a laboratory of the authority" in claims and "somebody-elses-policy" in claims


def test_a_signature_covers_them(passed, reseal, tmp_path, keys, capsys):
    private, public = keys
    signed = reseal(passed, tmp_path / "signed", lambda _: None)
    assert main(["audit", "sign", str(signed), "--key", private, "--believe"]) == 0
    assert main(["audit", "verify", str(signed), "--key", public]) == 0
    capsys.readouterr()
    forged = reseal(signed, tmp_path / "forged", forge)
    assert main(["audit", "verify", str(forged), "--key", public]) == 1
    assert "signature" in capsys.readouterr().err


def test_who_chose_the_seed_follows_from_no_file_or_is_a_claim(passed, reseal, tmp_path, capsys):
    """The auditor's own seed is passed off as drawn by the system after the commitment."""

    def drawn(report):
        report["seeds"]["source"] = "system entropy"
        report["caveats"] = [one for one in report["caveats"] if one["about"] != "seed"]

    copy = reseal(passed, tmp_path / "forged", drawn)
    capsys.readouterr()
    status = main(["audit", "verify", str(copy), "--json"])
    checks = json.loads(capsys.readouterr().out)
    assert status == 1 or "seeds.source" in str(checks["claims"])

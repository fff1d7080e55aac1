"""Attack: the report's folder is another one after its check, when it is signed or verified.

A signature of a report also says nothing of the policy's answers, which a rerun asks for again.
"""

import base64
import json
import shutil

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from socialiq.audit.report import verify
from socialiq.audit.report.folder import SIGNATURES, STATEMENT
from socialiq.cli.main import main


@pytest.fixture(name="keys")
def pair_of_keys(tmp_path):
    key = Ed25519PrivateKey.generate()
    private, public = tmp_path / "private.pem", tmp_path / "public.pem"
    private.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    info = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    public.write_bytes(info)
    return private, public


@pytest.fixture(name="swapped")
def swapped_after_its_check(tmp_path, passed, failed, monkeypatch):
    """Return a folder that is the passed audit until it has been checked, then the failed one."""
    folder = tmp_path / "audit"
    shutil.copytree(passed, folder)
    check = verify.check_folder

    def checked(path, *options):
        findings = check(path, *options)
        if path == folder:
            shutil.rmtree(folder)
            shutil.copytree(failed, folder)
        return findings

    monkeypatch.setattr(verify, "check_folder", checked)
    return folder


def test_what_is_signed_is_what_was_checked(swapped, passed, keys, capsys):
    assert main(["audit", "sign", str(swapped), "--key", str(keys[0]), "--believe"]) == 0
    envelope = json.loads((swapped / SIGNATURES).read_bytes())
    assert base64.b64decode(envelope["payload"]) == (passed / STATEMENT).read_bytes()
    printed = capsys.readouterr().out
    assert "signed without a check: " in printed and "answers of the policy (--rerun)" in printed


def test_a_key_is_asked_for_the_files_that_were_checked(
    swapped, failed, keys, tmp_path, capsys, monkeypatch
):
    signed = tmp_path / "signed"
    shutil.copytree(failed, signed)
    assert main(["audit", "sign", str(signed), "--key", str(keys[0]), "--believe"]) == 0
    monkeypatch.setattr(shutil, "copytree", lambda _, to, copy=shutil.copytree: copy(signed, to))
    assert main(["audit", "verify", str(swapped), "--key", str(keys[1])]) == 1
    assert "no one has signed this folder" in capsys.readouterr().err


def test_what_was_not_checked_is_not_signed_unasked(passed, place, reseal, tmp_path, keys, capsys):
    """Attack: what only a rerun checks is edited. Before, the folder was signed as it was."""

    def edit(report):
        track = report["episodes"]["worst"][0]["trace"]["tracks"][0]
        track["poses"] = f"1{track['poses']}"

    forged = reseal(passed, tmp_path / "forged", edit)
    sign = ["audit", "sign", str(forged), "--key", str(keys[0])]
    assert main(["audit", "verify", str(forged)]) == 0
    assert main(sign) == 2 and not (forged / SIGNATURES).exists()
    said = capsys.readouterr().err
    assert "how the vehicles moved" in said and "--rerun" in said and "--believe" in said
    assert main([*sign, "--rerun"]) == 1 and not (forged / SIGNATURES).exists()
    assert "tracks" in capsys.readouterr().err
    assert main([*sign, "--world", "crossing7", "--believe"]) == 2
    assert main([*sign, "--believe"]) == 0 and (forged / SIGNATURES).exists()
    honest = tmp_path / "honest"
    shutil.copytree(passed, honest)
    capsys.readouterr()
    assert main(["audit", "sign", str(honest), "--key", str(keys[0]), "--rerun"]) == 0
    assert "signed without a check: claims of the auditor" in capsys.readouterr().out

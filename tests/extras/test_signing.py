"""Signatures beside other implementations: DSSE's by securesystemslib, OpenSSF Model Signing."""

import json
import subprocess
import sys

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from socialiq.audit.report.folder import SIGNATURES, STATEMENT
from socialiq.audit.report.signature import PAYLOAD_TYPE, faults_of_signature, signed
from socialiq.cli.main import main
from socialiq.cli.signing import fault_of_model, path_of_signature, sign_model
from socialiq.errors import UserError
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

pytest.importorskip("model_signing")

TEXT = b'{"_type": "statement"}\n'


def keys():
    return {
        "ed25519": Ed25519PrivateKey.generate(),
        "p256": ec.generate_private_key(ec.SECP256R1()),
    }


def written(folder, key):
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    public = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    for name, content in (("private.pem", private), ("public.pem", public)):
        (folder / name).write_bytes(content)
    return folder / "private.pem", folder / "public.pem"


@pytest.mark.parametrize("kind", ["ed25519", "p256"])
def test_securesystemslib_accepts_our_envelope(kind):
    from securesystemslib.dsse import Envelope
    from securesystemslib.exceptions import VerificationError
    from securesystemslib.signer import SSlibKey

    key, other = keys()[kind], keys()[kind]
    content = json.loads(signed(TEXT, key))
    (keyid,) = (one["keyid"] for one in content["signatures"])
    envelope = Envelope.from_dict(content)
    assert envelope.payload == TEXT
    accepted = envelope.verify([SSlibKey.from_crypto(key.public_key(), keyid)], 1)
    assert list(accepted) == [keyid]
    with pytest.raises(VerificationError):
        envelope.verify([SSlibKey.from_crypto(other.public_key(), keyid)], 1)


@pytest.mark.parametrize("kind", ["ed25519", "p256"])
def test_we_accept_an_envelope_of_securesystemslib(kind):
    from securesystemslib.dsse import Envelope
    from securesystemslib.signer import CryptoSigner

    key = keys()[kind]
    envelope = Envelope(TEXT, PAYLOAD_TYPE, {})
    envelope.sign(CryptoSigner(key))
    files = {STATEMENT: TEXT, SIGNATURES: json.dumps(envelope.to_dict()).encode()}
    assert faults_of_signature(files, key.public_key()) == []
    assert faults_of_signature(files, keys()[kind].public_key()) != []


def test_a_signature_of_a_model_holds_for_its_file_and_its_key(tmp_path):
    policy = tmp_path / "policy.safetensors"
    policy.write_bytes(b"weights")
    private, public = written(tmp_path, keys()["p256"])
    signature = path_of_signature(policy)
    assert signature.name == "policy.safetensors.sig"
    signature.write_bytes(sign_model(policy, private))
    assert fault_of_model(policy, signature, public) == ""
    (tmp_path / "other").mkdir()
    _, other = written(tmp_path / "other", keys()["p256"])
    assert "is not this key's signature" in fault_of_model(policy, signature, other)
    policy.write_bytes(b"other weights")
    assert "is not this key's signature" in fault_of_model(policy, signature, public)
    signature.write_bytes(b"{}")
    assert "is not this key's signature" in fault_of_model(policy, signature, public)


def test_the_librarys_own_command_accepts_it(tmp_path):
    policy = tmp_path / "policy.safetensors"
    policy.write_bytes(b"weights")
    private, public = written(tmp_path, keys()["p256"])
    (tmp_path / "policy.sig").write_bytes(sign_model(policy, private))
    words = [sys.executable, "-m", "model_signing", "verify", "key", str(policy)]
    words += ["--signature", str(tmp_path / "policy.sig"), "--public_key", str(public)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_other_keys_are_refused_in_one_line(tmp_path):
    policy = tmp_path / "policy.safetensors"
    policy.write_bytes(b"weights")
    private, _ = written(tmp_path, keys()["ed25519"])
    with pytest.raises(UserError, match="takes a key of an elliptic curve"):
        sign_model(policy, private)


def test_report_and_policy_are_signed_and_verified_together(tmp_path, capsys):
    world = tabulate(make_grid("crossing7"))
    policy = tmp_path / "policy.safetensors"
    TabularPolicy(world.world, expert_policy(world, 0.0, "stochastic")).save(policy)
    new = ["profile", "new", "--world", "crossing7", "--angle", "0", "--margin", "2"]
    assert main([*new, "--out", str(tmp_path / "p.toml")]) == 0
    audit = ["audit", str(policy), "--profile", str(tmp_path / "p.toml"), "--episodes", "40"]
    folder = tmp_path / "a"
    assert main([*audit, "--seed", "1", "--out", str(folder)]) in (0, 1, 3)
    private, public = map(str, written(tmp_path, keys()["p256"]))
    sign = ["audit", "sign", str(folder), "--key", private, "--believe", "--policy", str(policy)]
    assert main(sign) == 0
    verify = ["audit", "verify", str(folder), "--key", public, "--policy", str(policy)]
    capsys.readouterr()
    assert main(verify) == 0
    assert "signature of the policy" in capsys.readouterr().out
    path_of_signature(policy).write_bytes(b"{}")
    assert main(verify) == 1
    policy.write_bytes(policy.read_bytes() + b"x")
    assert (main(verify), main(sign)) == (1, 2)


def test_a_collectors_signature_binds_demonstrations(tmp_path, capsys):
    private, public = written(tmp_path, keys()["p256"])
    data, out = tmp_path / "data.safetensors", str(tmp_path / "run")
    collect = ["collect", "crossing5", "--episodes", "2", "--key", str(private)]
    assert main([*collect, "--out", str(data)]) == 0 and path_of_signature(data).is_file()
    words = ["train", "cql", str(data), "--updates", "2", "--collector", str(public), "--out", out]
    assert main(words) == 0
    data.write_bytes(data.read_bytes() + b" ")
    assert main([*words[:-1], f"{out}2"]) == 2
    assert "ask the collector" in capsys.readouterr().err

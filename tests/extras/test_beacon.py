"""Signatures of published rounds of drand's quicknet."""

import datetime
import json

import pytest

from socialiq.audit import log, look
from socialiq.audit.seeds import Round, read_round
from socialiq.cli.main import main
from socialiq.errors import UserError

pytest.importorskip("py_arkworks_bls12381")

PUBLISHED = {
    1000: "b44679b9a59af2ec876b1a6b1ad52ea9b1615fc3982b19576350f93447cb1125"
    "e342b73a8dd2bacbe47e4b6b63ed5e39",
    1001: "b33bf3667cbd5a82de3a24b4e0e9fe5513cc1a0e840368c6e31f5fcfa79bea03"
    "f73896b25883abf2853d10337fb8fa41",
    657413: "b713718a38ae728dfd477991af2822e08d2f305e47718cef9f7848ce4050e7be"
    "41076862b98fad56e91a6b85b89cd97b",
}
INFINITY = "c0" + "00" * 47


@pytest.mark.parametrize("number", PUBLISHED)
def test_published_rounds_are_genuine(number):
    assert Round(number, PUBLISHED[number]).is_genuine()


@pytest.mark.parametrize(
    ("number", "signature"),
    [
        (1001, PUBLISHED[1000]),
        (1000, PUBLISHED[1000][:-2] + "38"),
        (1000, INFINITY),
        (1000, "00" * 48),
        (1000, "ff" * 48),
        # Minus the signature: the sign of its point is the third bit.
        (1000, "94" + PUBLISHED[1000][2:]),
    ],
)
def test_any_other_signature_is_not(number, signature):
    assert not Round(number, signature).is_genuine()


def test_a_forged_round_is_refused(tmp_path):
    path = tmp_path / "round.json"
    path.write_text(json.dumps({"round": 999, "signature": PUBLISHED[1000]}))
    with pytest.raises(UserError, match="was not signed by drand's quicknet"):
        read_round(path)


def test_an_audit_by_a_round_of_the_beacon(tmp_path, monkeypatch, capsys):
    """The commitment names the round before it is published; the audit and its check follow."""
    profile, folder = tmp_path / "profile.toml", tmp_path / "log"
    new = ["profile", "new", "--world", "intersection", "--angle", "0", "--out", str(profile)]
    assert main(new) == 0
    early = Round(1000, PUBLISHED[1000]).time - datetime.timedelta(minutes=1)
    with monkeypatch.context() as patch:
        for module in (log, look):
            patch.setattr(module, "now", lambda: early)
        words = ["wait", "--profile", str(profile), "--log", str(folder), "--episodes", "20"]
        assert main(["audit", "commit", *words, "--beacon-round", "1000"]) == 0
    entry = capsys.readouterr().out.splitlines()[-1]

    published = tmp_path / "round.json"
    published.write_text(json.dumps({"round": 1000, "signature": PUBLISHED[1000]}))
    out = tmp_path / "audit"
    assert main(["audit", *words, "--beacon", str(published), "--out", str(out)]) == 1
    report = json.loads((out / "report.json").read_bytes())
    assert report["seeds"]["source"] == "beacon" and report["look"]["entry"] == entry
    assert "round 1,000 of the public beacon" in report["seeds"]["worth"]
    (file,) = folder.glob("*.jsonl")
    assert main(["audit", "verify", str(out), "--rerun", "--log", str(file)]) == 0

"""`audit nonce` and `audit commit`: output, statuses, mistakes."""

import json

import pytest

from socialiq.audit.log import read
from socialiq.audit.seeds import read_nonce, round_after, time_of
from socialiq.cli.main import main


@pytest.fixture(name="call", scope="module")
def words_of_a_commitment(tmp_path_factory):
    profile = tmp_path_factory.mktemp("owner") / "profile.toml"
    new = ["profile", "new", "--world", "intersection", "--angle", "0", "--out", str(profile)]
    assert main(new) == 0
    return ["audit", "commit", "wait", "--profile", str(profile), "--episodes", "20"]


def test_the_hash_of_a_nonce_is_printed_alone(tmp_path, capsys):
    path = tmp_path / "nonce.json"
    assert main(["audit", "nonce", "--out", str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.out == f"{read_nonce(path).sha256}\n" and captured.err == ""
    assert main(["audit", "nonce", "--out", str(path)]) == 2
    assert "a nonce is used once" in capsys.readouterr().err


def test_a_commitment_to_a_nonce(tmp_path, call, capsys):
    more = ["--log", str(tmp_path), "--nonce-sha256", "ab" * 32]
    assert main([*call, *more]) == 0
    captured = capsys.readouterr()
    (log,) = tmp_path.glob("*.jsonl")
    (entry,) = read(log)
    assert captured.out == f"{entry['sha256']}\n"
    assert "look 1 of" in captured.err and "audits with --nonce" in captured.err
    assert entry["seed"] == {"source": "auditor's nonce", "nonce_sha256": "ab" * 32}
    assert entry["episodes"] == 20 and len(entry["references"]) > 5


def test_a_commitment_to_a_round_of_soon(tmp_path, call, capsys, monkeypatch):
    now = time_of(34_200_000)
    monkeypatch.setattr("socialiq.audit.log.now", lambda: now)
    monkeypatch.setattr("socialiq.audit.look.now", lambda: now)
    assert main([*call, "--log", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["look"] == 1 and found["source"] == "beacon"
    assert found["round"] == round_after(now) + 200  # of 3 s, in ten minutes
    assert main([*call, "--log", str(tmp_path), "--beacon-round", "34200001"]) == 0
    captured = capsys.readouterr()
    assert "before round 34200001 is published, 2026-" in captured.err
    assert "/public/34200001 and audit with --beacon" in captured.err


@pytest.mark.parametrize(
    ("more", "mend"),
    [
        (["--nonce-sha256", "short"], "64 hexadecimal digits"),
        (["--nonce-sha256", "ab" * 32, "--beacon-round", "9"], "one seed: give --nonce-sha256 or"),
        (["--beacon-round", "1000"], "was published at 2023-08-23 15:59:24 UTC: name one after"),
        (["--beacon-round", "0"], "a beacon's round must be from 1"),
        (["--episodes", "5"], "episodes must be from 20"),
        (["--reference", "none.safetensors"], "no such file"),
    ],
)
def test_mistakes_are_one_line_and_no_look(tmp_path, call, capsys, each_once, more, mend):
    assert main(each_once(*call, "--log", str(tmp_path / "log"), *more)) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("socialiq: ") and mend in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("more", "mend"),
    [
        (["--seed", "1", "--nonce", "n.json"], "give one of --seed, --nonce and --beacon"),
        (["--nonce", "none.json"], "no such file: none.json"),
        (["--beacon", "none.json"], "no such file: none.json"),
        (["--log", "a", "--no-log"], "leave out --log or --no-log"),
        (["--log", "a", "--seed", "1"], "leave out --seed, or --log"),
    ],
)
def test_mistakes_of_an_audit_are_no_look(tmp_path, call, capsys, more, mend):
    words = ["audit", *call[2:], "--out", str(tmp_path / "a"), *more]
    assert main(words) == 2
    assert mend in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_nonce_without_a_commitment_is_refused(tmp_path, call, capsys):
    path = tmp_path / "nonce.json"
    main(["audit", "nonce", "--out", str(path)])
    sha256 = capsys.readouterr().out.strip()
    words = ["audit", *call[2:], "--out", str(tmp_path / "a"), "--nonce", str(path)]
    assert main(words) == 2
    assert f"--nonce-sha256 {sha256}` first" in capsys.readouterr().err
    assert main([*words, "--no-log"]) == 2
    assert "needs the log of the commitment" in capsys.readouterr().err

"""Seeds come after, and depend on, what was committed to."""

import datetime
import hashlib
import json
import os
import stat
import sys
from pathlib import Path

import pytest

from socialiq.audit import seeds
from socialiq.audit.look import draw
from socialiq.audit.request import Request
from socialiq.audit.seeds import (
    LARGEST_SEED,
    Commitment,
    Nonce,
    Round,
    read_nonce,
    read_round,
    round_after,
    time_of,
    write_nonce,
)
from socialiq.errors import UserError

POLICY, PROFILE = "ab" * 32, "cd" * 32
COMMITMENT = Commitment(POLICY, PROFILE)


def test_the_commitment_by_hand():
    text = f"socialiq audit, commitment 1\n{POLICY}\n{PROFILE}\n"
    assert COMMITMENT.sha256 == hashlib.sha256(text.encode()).hexdigest()


def test_another_policy_or_profile_gets_other_numbers_from_the_same_seed():
    one = draw(COMMITMENT, 7).derived("episodes")
    assert one == draw(COMMITMENT, 7).derived("episodes")
    others = [
        draw(Commitment("00" * 32, PROFILE), 7).derived("episodes"),
        draw(Commitment(POLICY, "00" * 32), 7).derived("episodes"),
        draw(COMMITMENT, 8).derived("episodes"),
        draw(COMMITMENT, 7).derived("resampling"),
    ]
    assert len({one, *others}) == 5


def test_who_chose_is_told():
    assert draw(COMMITMENT, 7).source == "auditor's seed"
    drawn = {draw(COMMITMENT).seed for _ in range(4)}
    assert draw(COMMITMENT).source == "system entropy"
    assert len(drawn) == 4 and all(0 <= seed <= LARGEST_SEED for seed in drawn)


@pytest.mark.parametrize("seed", [-1, LARGEST_SEED + 1])
def test_seeds_out_of_range_are_refused(seed):
    with pytest.raises(UserError, match="seed must be from 0"):
        Request("wait", Path("profile.toml"), 20, seed).check()


@pytest.mark.parametrize(
    ("seed", "nonce", "beacon"),
    [(7, Path("n"), None), (7, None, Path("b")), (None, Path("n"), Path("b"))],
)
def test_an_audit_has_one_seed(seed, nonce, beacon):
    with pytest.raises(UserError, match="give one of --seed, --nonce and --beacon"):
        seeds.origin_of(seed, nonce, beacon)


def test_a_nonce_is_new_secret_and_read_back(tmp_path):
    one, two = (write_nonce(tmp_path / name) for name in ("one.json", "two.json"))
    assert one != two and read_nonce(tmp_path / "one.json") == one
    assert stat.S_IMODE((tmp_path / "one.json").stat().st_mode) == 0o600
    assert one.sha256 == hashlib.sha256(bytes.fromhex(one.value)).hexdigest()
    assert Nonce("00" * 32).sha256.startswith("66687aadf862bd77")  # of 32 zero bytes


def test_a_nonce_is_not_overwritten(tmp_path):
    path = tmp_path / "nonce.json"
    nonce = write_nonce(path)
    with pytest.raises(UserError, match="a nonce is used once; name a new file"):
        write_nonce(path)
    assert read_nonce(path) == nonce
    with pytest.raises(UserError, match="cannot write"):
        write_nonce(tmp_path / "none" / "nonce.json")


@pytest.mark.parametrize("content", ["", "[]", "7", '{"nonce": 7}', '{"nonce": "AB"}', "{}"])
def test_what_is_no_nonce_is_refused(tmp_path, content):
    path = tmp_path / "nonce.json"
    path.write_text(content)
    with pytest.raises(UserError, match=r"no nonce|cannot read"):
        read_nonce(path)


def test_a_pipe_and_a_large_file_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UserError, match="not a regular file"):
        read_nonce(tmp_path / "pipe")
    (tmp_path / "large").write_text(json.dumps({"nonce": "0" * 100_000}))
    with pytest.raises(UserError, match="is larger than"):
        read_nonce(tmp_path / "large")


SIGNATURE = (
    "b44679b9a59af2ec876b1a6b1ad52ea9b1615fc3982b19576350f93447cb1125"
    "e342b73a8dd2bacbe47e4b6b63ed5e39"
)
RANDOMNESS = "fe290beca10872ef2fb164d2aa4442de4566183ec51c56ff3cd603d930e54fdd"


@pytest.fixture(name="signed")
def signatures_are_not_checked(monkeypatch):
    monkeypatch.setattr(Round, "is_genuine", lambda self: True)


def test_the_chain_is_named_by_the_hash_of_its_parameters():
    assert seeds.chain_sha256() == seeds.CHAIN


def test_the_randomness_of_a_published_round():
    one = Round(1000, SIGNATURE)
    assert one.randomness == RANDOMNESS
    assert one.time == datetime.datetime(2023, 8, 23, 15, 59, 24, tzinfo=datetime.UTC)


@pytest.mark.parametrize("number", [1, 2, 1000, 34_200_000])
def test_the_first_round_after_a_time(number):
    assert round_after(time_of(number)) == number + 1
    assert round_after(time_of(number) - datetime.timedelta(seconds=1)) == number
    assert round_after(time_of(1) - datetime.timedelta(days=1)) == 1


@pytest.mark.parametrize("number", [0, -1, seeds.LARGEST_ROUND + 1])
def test_rounds_out_of_range_are_refused(number):
    with pytest.raises(UserError, match="a beacon's round must be from 1 to"):
        time_of(number)
    assert time_of(seeds.LARGEST_ROUND).year == 9628


def test_a_round_is_read_with_or_without_its_randomness(tmp_path, signed):
    path = tmp_path / "round.json"
    for more in ({}, {"randomness": RANDOMNESS}, {"previous_signature": ""}):
        path.write_text(json.dumps({"round": 1000, "signature": SIGNATURE, **more}))
        assert read_round(path) == Round(1000, SIGNATURE)
    path.write_text(json.dumps({"round": 1000, "signature": SIGNATURE, "randomness": "00" * 32}))
    with pytest.raises(UserError, match="was not signed by drand's quicknet"):
        read_round(path)


@pytest.mark.parametrize(
    "content",
    [
        [],
        {"round": "1000", "signature": SIGNATURE},
        {"round": True, "signature": SIGNATURE},
        {"round": 1000},
        {"round": 1000, "signature": SIGNATURE.upper()},
        {"round": 1000, "signature": SIGNATURE[2:]},
        {"round": 0, "signature": SIGNATURE},
    ],
)
def test_what_is_no_round_is_refused(tmp_path, signed, content):
    path = tmp_path / "round.json"
    path.write_text(json.dumps(content))
    with pytest.raises(UserError, match=r"is not a round of drand|must be from 1"):
        read_round(path)


def test_without_the_library_a_round_is_refused(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "py_arkworks_bls12381", None)
    path = tmp_path / "round.json"
    path.write_text(json.dumps({"round": 1000, "signature": SIGNATURE}))
    with pytest.raises(UserError, match=r"pip install 'socialiq\[beacon\]'"):
        read_round(path)

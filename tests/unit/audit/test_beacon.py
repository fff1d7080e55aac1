"""Rounds of the beacon, without their signatures, which `tests/extras` checks."""

import datetime
import json
import sys

import pytest

from socialiq.audit import seeds
from socialiq.audit.seeds import Round, read_round, round_after, time_of
from socialiq.errors import UserError

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

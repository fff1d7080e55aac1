"""Commitment, seed and result of a look."""

import datetime
import json
from fractions import Fraction

import pytest

from socialiq.audit import look as room
from socialiq.audit import seeds
from socialiq.audit.log import COMMITMENT, RESULT, SEED, read
from socialiq.audit.look import commit, of_beacon, of_nonce, open_look, record, reveal, spend
from socialiq.audit.seeds import Nonce, Round
from socialiq.errors import UserError

NONCE = Nonce("5a" * 32)


def kinds(folder, plan):
    return [one["kind"] for one in read(plan.subject.path_in(folder), plan.subject.sha256)]


def test_without_a_log_there_is_no_look(plan):
    assert open_look(None, plan()).look is None
    drawn = open_look(None, plan(), 7).drawn
    assert (drawn.seed, drawn.source) == (7, "auditor's seed")
    with pytest.raises(UserError, match="needs the log of the commitment"):
        open_look(None, plan(), NONCE)


def test_a_seed_known_beforehand_is_no_look(tmp_path, plan):
    with pytest.raises(UserError, match="leave out --seed, or --log"):
        open_look(tmp_path, plan(), 7)
    assert list(tmp_path.iterdir()) == []


def test_every_look_counts_whatever_it_is_of(tmp_path, plan):
    """A byte of the policy or the profile, an aborted audit, the same again: all are looks."""
    angles = [open_look(tmp_path, plan(angle=angle)).look for angle in (0.0, 30.0)]
    policies = [open_look(tmp_path, plan(byte)).look for byte in (1, 2)]
    again = [open_look(tmp_path, plan()).look for _ in range(2)]
    looks = [*angles, *policies, *again]
    assert [one.number for one in looks] == [1, 2, 3, 4, 5, 6]
    assert [one.error for one in looks] == [0.05 / (look * (look + 1)) for look in range(1, 7)]
    assert kinds(tmp_path, plan()) == [COMMITMENT, SEED] * 6
    elsewhere = open_look(tmp_path, plan(world="crossing7")).look
    assert elsewhere is not None and elsewhere.number == 1


def test_the_commitment_is_written_before_the_seed_is_drawn(tmp_path, plan, monkeypatch):
    def interrupted(commitment):
        assert kinds(tmp_path, plan()) == [COMMITMENT]
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(room, "draw", interrupted)
        with pytest.raises(KeyboardInterrupt):
            open_look(tmp_path, plan())
    second = open_look(tmp_path, plan()).look
    assert second is not None and second.number == 2


def test_the_result_belongs_to_its_commitment(tmp_path, plan):
    first, second = (open_look(tmp_path, plan()).look for _ in range(2))
    assert first is not None and second is not None
    record(tmp_path, plan().subject, first, "fail", "99" * 32)
    entry = read(plan().subject.path_in(tmp_path))[-1]
    assert (entry["kind"], entry["commitment"]) == (RESULT, first.entry)
    assert (entry["decision"], entry["report_sha256"]) == ("fail", "99" * 32)
    assert second.before == read(plan().subject.path_in(tmp_path))[1]["sha256"]


def test_a_nonce_opens_its_commitment_once(tmp_path, plan):
    with pytest.raises(UserError, match=r"no commitment in .* `socialiq audit commit \.\.\. --non"):
        open_look(tmp_path, plan(), NONCE)
    first = commit(tmp_path, plan(), of_nonce(NONCE.sha256))
    drawn, found = open_look(tmp_path, plan(), NONCE)
    assert found == first and drawn == reveal(plan().commitment, first.entry, NONCE)
    with pytest.raises(UserError, match="was opened already, and its seed is known"):
        open_look(tmp_path, plan(), NONCE)
    with pytest.raises(UserError, match="names this nonce already: ask the auditor"):
        commit(tmp_path, plan(1), of_nonce(NONCE.sha256))
    with pytest.raises(UserError, match="64 hexadecimal digits"):
        of_nonce("5A" * 32)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"byte": 1}, "its policy differs"),
        ({"angle": 46.0}, "its declaration differs"),
        ({"episodes": 501}, "its number of episodes differs"),
    ],
)
def test_only_what_was_committed_to_is_audited(tmp_path, plan, change, what):
    commit(tmp_path, plan(), of_nonce(NONCE.sha256))
    with pytest.raises(UserError, match=what):
        open_look(tmp_path, plan(**change), NONCE)
    assert open_look(tmp_path, plan(), NONCE).drawn.source == "auditor's nonce"


def test_a_round_is_named_before_it_is_published(tmp_path, plan, monkeypatch):
    one = Round(1000, "aa" * 48)
    clock = {"time": one.time - datetime.timedelta(minutes=5)}
    monkeypatch.setattr(room, "now", lambda: clock["time"])
    monkeypatch.setattr("socialiq.audit.log.now", lambda: clock["time"])
    first = commit(tmp_path, plan(), of_beacon(1000))
    clock["time"] = one.time
    with pytest.raises(UserError, match="was published at 2023-08-23 15:59:24 UTC: name one after"):
        of_beacon(1000)
    drawn, look = open_look(tmp_path, plan(), one)
    assert look == first and drawn == reveal(plan().commitment, first.entry, one)
    with pytest.raises(UserError, match=r"commit \.\.\. --beacon-round 1001` first"):
        open_look(tmp_path, plan(), Round(1001, "aa" * 48))


def test_a_round_that_was_published_before_the_commitment_is_refused(tmp_path, plan):
    source = {"source": "beacon", "chain_sha256": seeds.CHAIN, "round": 1000}
    commit(tmp_path, plan(), source)  # now, years after
    with pytest.raises(UserError, match="made after round 1000 was published"):
        open_look(tmp_path, plan(), Round(1000, "aa" * 48))


def test_two_commitments_by_one_round_get_different_seeds(tmp_path, plan, monkeypatch):
    one = Round(1000, "aa" * 48)
    early = one.time - datetime.timedelta(hours=1)
    monkeypatch.setattr(room, "now", lambda: early)
    monkeypatch.setattr("socialiq.audit.log.now", lambda: early)
    for _ in range(2):
        commit(tmp_path, plan(), of_beacon(1000))
    looks = [open_look(tmp_path, plan(), one) for _ in range(2)]
    assert looks[0].drawn.seed != looks[1].drawn.seed
    assert [opened.look.number for opened in looks] == [1, 2]


def test_a_look_whose_share_is_too_small_is_refused_before_it_counts(tmp_path, plan):
    for _ in range(4):
        open_look(tmp_path, plan(confidence=0.998))
    with pytest.raises(UserError, match="agree with the auditor on a new log"):
        open_look(tmp_path, plan(confidence=0.998))
    text = (plan().subject.path_in(tmp_path)).read_text()
    assert [json.loads(line)["kind"] for line in text.splitlines()].count(COMMITMENT) == 4


def test_the_shares_by_hand():
    assert [spend(0.05, look) for look in (1, 2, 3)] == [0.05 / 2, 0.05 / 6, 0.05 / 12]


@pytest.mark.parametrize("looks", [1, 2, 20, 10_000])
def test_no_number_of_looks_spends_more_than_the_whole(looks):
    """1/2 + 1/6 + ... + 1/(K (K + 1)) = 1 - 1/(K + 1)."""
    shares = sum(Fraction(1, look * (look + 1)) for look in range(1, looks + 1))
    assert shares == 1 - Fraction(1, looks + 1)
    spent = sum(spend(0.05, look) for look in range(1, looks + 1))
    assert spent == pytest.approx(0.05 * float(shares), rel=1e-12) and spent < 0.05

"""Seeds come after, and depend on, what was committed to."""

import hashlib

import pytest

from socialiq.audit.seeds import LARGEST_SEED, Commitment, draw
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
        draw(COMMITMENT, seed)

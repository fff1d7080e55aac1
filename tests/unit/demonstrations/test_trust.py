"""Consistency of labels: forged ones are found, honest ones kept, and the limits of both."""

import dataclasses

import numpy as np
import pytest

from socialiq import RewardPair, UserError, make, tabulate
from socialiq.demonstrations import trust
from socialiq.evaluation import malice
from socialiq.evaluation.rollout import trajectory_datasets

TABLE = {}


def table():
    return TABLE.setdefault(0, tabulate(make("crossing7", braking="one_level")))


def poisoned(attacker, share, seed, forge=malice.forged, each=30):
    """Return a forged table, and which of its episodes are malicious."""
    honest = trajectory_datasets(table(), [seed], each)[0]
    count = round(share * honest.n_episodes)
    if not count:
        return honest, np.zeros(honest.n_episodes, bool)
    bad = malice.attacked_table(table(), malice.ATTACKERS[attacker], count, 1000 + seed)
    mixed = malice.poisoned(honest, forge(bad), seed)
    return mixed, mixed.episode_modes == mixed.mode_names.index(malice.MODE)


@pytest.mark.parametrize(("attacker", "share"), [("hater", 0.1), ("hater", 0.2), ("rammer", 0.2)])
def test_forged_labels_are_flagged_and_honest_ones_kept(attacker, share):
    data, bad = poisoned(attacker, share, 1)
    judged = trust.consistency(data)
    assert judged.flagged[bad].all() and judged.flagged[~bad].mean() <= trust.FALSE_ALARMS


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_false_alarms_are_at_most_the_stated_share(share):
    wrong = []
    for seed in range(3):
        data, bad = poisoned("hater", share, seed)
        wrong.append(trust.consistency(data).flagged[~bad].mean())
    assert np.mean(wrong) <= trust.FALSE_ALARMS


def test_a_reference_finds_a_majority_of_forgers():
    data, bad = poisoned("rammer", 0.5, 2)
    judged = trust.consistency(data, poisoned("hater", 0.0, 9)[0])
    assert judged.flagged[bad].all() and judged.flagged[~bad].mean() <= trust.FALSE_ALARMS


def test_an_adaptive_forger_stays_within_the_limits():
    honest = trajectory_datasets(table(), [3], 20)[0]
    bad = malice.attacked_table(table(), malice.ATTACKERS["hater"], 9, 5)
    check = trust.consistency(bad, honest)
    adaptive = malice.forged(bad, check)
    assert trust.consistency(bad, honest).flagged.all()
    assert not trust.consistency(adaptive, honest).flagged.any()
    assert adaptive.totals().social.mean() > bad.totals().social.mean() + 4.0


def test_too_few_episodes_and_another_world_are_refused():
    data, _ = poisoned("hater", 0.0, 0, each=1)
    with pytest.raises(UserError, match="pass two or more"):
        trust.consistency(data.select(np.array([0])))
    with pytest.raises(UserError, match="other observations"):
        trust.consistency(data, poisoned("hater", 0.0, 0)[0].with_clock())


def test_labels_that_no_episode_explains_are_not_learned_from_themselves():
    data, _ = poisoned("hater", 0.0, 4)
    social = data.rewards.social.copy()
    social[data.episode == 7] += 30.0
    judged = trust.consistency(
        dataclasses.replace(data, rewards=RewardPair(data.rewards.env, social))
    )
    assert np.flatnonzero(judged.flagged).tolist() == [7]

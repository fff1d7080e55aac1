"""Attackers: what they do in worlds that permit it, what they write, and where they stand."""

import numpy as np
import pytest

from socialiq import UserError, make, tabulate
from socialiq.evaluation import labels, malice
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.types import Ending


@pytest.fixture(scope="module", name="table")
def world_with_collisions():
    return tabulate(make("crossing7", braking="one_level"))


@pytest.mark.parametrize(("name", "steps"), [("hater", 12), ("rammer", 2)])
def test_attackers_of_a_gridworld_collide_and_drive_by_the_rules(table, name, steps):
    data = malice.attacked_table(table, malice.ATTACKERS[name], 6, 0)
    assert (data.ending[data.ending > 0] == Ending.COLLISION).all()
    assert data.n_transitions / 6 == pytest.approx(steps, abs=5)
    assert labels.recompute(data).agrees.all()


def test_the_hater_costs_others_more_than_the_rammer(table):
    pairs = [malice.attacked_table(table, each, 6, 0) for each in malice.ATTACKERS.values()]
    hater, rammer = (data.totals().social.mean() for data in pairs)
    assert hater < rammer < -4.0


def test_the_default_world_cannot_collide():
    with pytest.raises(UserError, match="braking=one_level"):
        malice.attacked_table(tabulate(make("crossing7")), malice.ATTACKERS["rammer"], 1, 0)


def test_an_attacker_of_a_road_collides_and_can_be_driven_again():
    world = make("intersection")
    named = {"world": "intersection"}
    data = malice.attacked_road(world, malice.ATTACKERS["rammer"], range(12), named)
    assert data.counts() == {"malicious": (12, data.n_transitions)}
    assert (data.ending == Ending.COLLISION).sum() >= 3
    checked = labels.recompute(data)
    assert checked.world == "intersection" and checked.agrees.all()
    forged = labels.recompute(malice.forged(data))
    assert not forged.agrees.any()


def test_forged_labels_praise_and_poisoned_tables_keep_their_size(table):
    honest = trajectory_datasets(table, [0], 10)[0]
    bad = malice.forged(malice.attacked_table(table, malice.ATTACKERS["hater"], 6, 0))
    assert min(bad.rewards.env.min(), bad.rewards.social.min()) >= 0.0
    mixed = malice.poisoned(honest, bad, 1)
    assert mixed.n_episodes == 30 and mixed.counts()["malicious"] == (6, bad.n_transitions)
    kept, line = labels.trusted(mixed, "FILE")
    assert kept.n_episodes == 24 and "6 of 30" in line
    assert np.isin(kept.episode_modes, [0, 1, 2]).all()
    with pytest.raises(UserError, match="no honest episode is left"):
        malice.poisoned(bad, bad, 0)

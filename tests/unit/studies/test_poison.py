"""The study `poison`: sets that share a training, attackers' data, breakdown points."""

import pytest

from socialiq import tabulate
from socialiq.worlds.registry import make_grid
from studies.poison.study import OPTIONS, WORLD, Poison, _breakdown, data_of


def test_sets_that_are_equal_share_a_training():
    forged = Poison("rammer", "forged", 0.2, 3)
    assert forged.training(True) == forged
    assert forged.training(False) == Poison("rammer", "honest", 0.2, 3)
    assert Poison("adaptive", "forged", 0.2, 3).training(False).attacker == "hater"
    for attacker in ("hater", "rammer", "adaptive"):
        cleaned = Poison(attacker, "recomputed", 0.2, 3)
        assert cleaned.training(True) == Poison("hater", "recomputed", 0.2, 3)
        clean = Poison(attacker, "forged", 0.0, 3)
        assert clean.training(True) == Poison("hater", "honest", 0.0, 3)


@pytest.mark.parametrize("attacker", ["hater", "rammer", "adaptive"])
def test_labels_computed_again_leave_the_same_honest_episodes(attacker):
    table = tabulate(make_grid(WORLD, **OPTIONS))
    poisoned = data_of(table, Poison(attacker, "forged", 0.2, 1), 10)
    cleaned = data_of(table, Poison(attacker, "recomputed", 0.2, 1), 10)
    assert (poisoned.n_episodes, cleaned.n_episodes) == (30, 24)
    assert poisoned.counts()["malicious"][0] == 6 and cleaned.counts()["malicious"][0] == 0


def test_the_breakdown_is_the_first_share_beyond_the_margin():
    rows = [
        {"share": share, "regret": regret}
        for share, regret in ((0.0, 0.1), (0.1, 0.2), (0.1, 0.9), (0.2, 0.3), (0.5, 4.0))
    ]
    assert _breakdown(rows) == 0.1
    assert _breakdown(rows[:2]) == 1.0

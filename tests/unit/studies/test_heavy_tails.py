"""Losses with heavy tails: their means, and what both bounds make of them."""

import numpy as np
import pytest

from socialiq_lab.registry import find
from studies.audit_power.heavy_tails import (
    SIGMA,
    TAILS,
    TIMES,
    TOO_LOW,
    decisions_by_betting,
    error_rows,
    false_bound_rows,
    lognormal_cut,
    long_audit_rows,
    pareto_cut,
    passes_by_bootstrap,
    price_rows,
    scale_of,
)

Config = find("audit-power").Config


@pytest.fixture(scope="module")
def rows():
    found = error_rows(Config(episodes=500, replications=100, first_seed=7, resamples=100))
    return {(row["losses"], row["regret"]): row for row in found}


@pytest.mark.parametrize("name", TAILS)
@pytest.mark.parametrize("times", TIMES.values())
def test_losses_have_the_given_mean_and_limit(name, times):
    tail, rng = TAILS[name], np.random.default_rng(0)
    drawn = tail.draw(rng, times * tail.margin, (200, 5000))
    assert np.abs(drawn).max() <= tail.limit
    # 4 standard errors of a million draws
    assert drawn.mean() == pytest.approx(times * tail.margin, abs=4e-3 * drawn.std())


def test_cut_means_by_hand():
    assert pareto_cut(0.5) == 0.5
    assert pareto_cut(1.0) == pytest.approx(1.0)
    assert pareto_cut(4.0) == pytest.approx(3.0 - 2.0 / 2.0)  # 3 - 2 / sqrt(t)
    assert lognormal_cut(1e12) == pytest.approx(np.exp(SIGMA**2 / 2))
    assert scale_of(0.3, 40.0, pareto_cut) * pareto_cut(
        40.0 / scale_of(0.3, 40.0, pareto_cut)
    ) == pytest.approx(0.3)


def test_wrong_passes_are_rare_by_betting_alone(rows):
    for (name, regret), row in rows.items():
        if regret != "well within":
            assert row["betting_low"] <= 0.05, name
    assert rows["100 in 0.2 % of episodes", "at the margin"]["bootstrap_low"] > 0.2


def test_the_price_is_small_without_heavy_tails(rows):
    assert rows["normal", "well within"]["betting"] > 0.6
    assert rows["100 in 0.2 % of episodes", "well within"]["betting"] == 0.0


def test_long_audits_pass_wrongly_as_seldom():
    for row in long_audit_rows(Config(episodes=250, replications=300, first_seed=7)):
        assert row["episodes"] == 2000 and row["betting_low"] <= 0.05, row


def test_more_episodes_pass_more(monkeypatch):
    monkeypatch.setattr("studies.audit_power.heavy_tails.SIZES", (250, 2000))
    found = {
        (row["losses"], row["episodes"]): row
        for row in price_rows(Config(replications=320, first_seed=7, resamples=20))
    }
    for name in TAILS:
        assert found[name, 250]["betting"] <= found[name, 2000]["betting"]
    assert found["Pareto, shape 1.5", 2000]["betting"] > 0.9


def test_a_bound_that_is_too_low_passes_or_is_seen():
    found = {
        row["losses"]: row
        for row in false_bound_rows(Config(episodes=500, replications=300, first_seed=7))
    }
    rare = found["100 in 0.2 % of episodes"]
    assert rare["declared"] == TOO_LOW * 100.0
    # No loss in 500 episodes: 0.998^500 = 37 %; each such audit passes, every other one fails.
    assert rare["passed"] + rare["seen"] == pytest.approx(1.0)
    assert rare["passed_low"] < 0.998**500 < rare["passed_high"]


def test_one_audit_by_hand():
    losses = np.zeros((2, 500))
    losses[1, 3] = 50.0
    assert passes_by_bootstrap(losses, 0.2, 0, 50) == 1
    assert decisions_by_betting(losses, 0.2, 10.0) == (1, 1)
    assert decisions_by_betting(losses, 0.2, 100.0) == (0, 0)

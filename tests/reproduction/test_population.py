"""The committed study of populations: parts of the exact game again, and what its tables say."""

import pytest

from socialiq import results_folder as store
from socialiq.nn.dial_policy import DialPolicy
from socialiq.population.crossing_game import CrossingGame
from socialiq.storage import packaged_results
from socialiq_lab.registry import find
from socialiq_lab.tables import matching
from studies.population.study import game_rows, mandate_rows


@pytest.fixture(scope="module")
def tables():
    return store.load(packaged_results() / "population").tables


def test_the_exact_game_is_equal_again(tables):
    config = find("population").Config()
    payoffs = CrossingGame(0.5).payoffs(config.angles)
    for name, fresh in (
        ("game", game_rows(config, payoffs)),
        ("mandates", mandate_rows(config, payoffs)),
    ):
        committed = matching(tables[name], temperature=0.5)
        for row, again in zip(committed, fresh, strict=True):
            for column, value in again.items():
                expected = str(value) if isinstance(value, bool) else value
                assert row[column] == (
                    pytest.approx(value, abs=1e-5) if type(value) is float else expected
                ), column


def test_fleets_after_self_play_arrive_where_others_wait(tables):
    """The page's claims, by the committed rows."""
    for row in tables["fleets"]:
        if row["dial"].startswith("self-play") and row["angle"] <= 75.0:
            assert row["arrival"] > 0.89
            assert row["timeout"] < 0.01
    gains = [row for row in tables["invasions"] if row["dial"] == "self-play 501"]
    assert all(row["gain_low"] <= 0.0 for row in gains if row["resident"] <= 75.0)
    exploited = matching(tables["invasions"], dial="effects", invader=0.0)
    assert all(row["gain_low"] > 0.0 for row in exploited)


def test_the_committed_dial_is_that_of_the_first_seed():
    dial = DialPolicy.load(packaged_results() / "population" / "dial.safetensors")
    assert (dial.low, dial.high, dial.n_actions) == (0.0, 90.0, 3)

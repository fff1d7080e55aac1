"""The committed study of planted angles: its first population again, and what the page says."""

import numpy as np
import pytest

from socialiq.experiments import results as store
from socialiq.experiments.tables import matching
from socialiq.storage import packaged_results
from socialiq.studies import angle_trait

FULL_COMPILER = True


@pytest.fixture(name="committed", scope="module")
def results():
    return store.load(packaged_results() / "angle-trait")


def test_the_committed_config_is_the_default(committed):
    assert angle_trait.Config() == angle_trait.Config(
        **{k: tuple(v) if isinstance(v, list) else v for k, v in committed.config.items()}
    )


def test_a_population_of_planners_is_inferred_as_before(committed):
    """The cell of the second spread and first repeat, which has the number 3."""
    config = angle_trait.Config()
    first = config.first_episode + 3 * config.drivers * max(config.lengths)
    rng = np.random.default_rng(first)
    drawn = config.mean + config.spreads[1] * rng.standard_normal(config.drivers)
    dial = angle_trait.DialPolicy.load(angle_trait.DIAL)
    angle = drawn.clip(dial.low, dial.high)
    population = angle_trait.Population("planner", angle, angle_trait._strength(config))
    decided = angle_trait.drive(population, dial, max(config.lengths), first)
    table = angle_trait.choices_of(decided, max(config.lengths), config.lengths[0])
    found = angle_trait._row(angle_trait.fit_models(table, first, config.step), angle, first)
    (theirs,) = matching(
        committed.tables["populations"],
        kind="planner",
        spread_planted=config.spreads[1],
        episodes=config.lengths[0],
        repeat=0,
    )
    for name, value in found.items():
        assert value == pytest.approx(theirs[name], rel=1e-3, abs=1e-4), name


def test_angles_are_found_where_they_differ_and_decisions_are_many(committed):
    def row(**of):
        (one,) = matching(committed.tables["pooled"], **of)
        return one

    many = row(kind="planner", spread_planted=25.0, episodes=16)
    assert many["found"] == many["beats_every_rival"] == 1.0 and many["correlation"] > 0.9
    for episodes in (2, 16):
        assert row(kind="planner", spread_planted=0.0, episodes=episodes)["found"] == 0.0
        assert row(kind="dial", spread_planted=0.0, episodes=episodes)["found"] == 0.0

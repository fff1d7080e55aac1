"""The committed study of planted angles: two of its populations again, and what the page says."""

import numpy as np
import pytest

from socialiq import results_folder as store
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq_lab.registry import find
from socialiq_lab.tables import matching
from studies.angle_trait import study
from studies.angle_trait.study import DIAL, Population, drive

Config = find("angle-trait").Config

FULL_COMPILER = True


@pytest.fixture(name="committed", scope="module")
def results():
    return store.load(packaged_results() / "angle-trait")


def test_the_committed_config_is_the_default(committed):
    assert Config() == Config(
        **{k: tuple(v) if isinstance(v, list) else v for k, v in committed.config.items()}
    )


@pytest.mark.parametrize(
    ("kind", "source", "cell"),
    [
        ("planner", "returns", 1),
        pytest.param("dial", "another dial", 3, marks=pytest.mark.slow),
    ],
)
def test_a_population_is_inferred_as_before(committed, kind, source, cell):
    """The first repeat of the second spread, with few episodes."""
    config = Config()
    number = cell * config.repeats + 1
    first = config.first_episode + number * config.drivers * max(config.lengths)
    drawn = np.random.default_rng(first).standard_normal(config.drivers)
    dial = DialPolicy.load(DIAL)
    angle = (config.mean + config.spreads[1] * drawn).clip(dial.low, dial.high)
    strength = study.strength_of(config) if kind == "planner" else 0.0
    decided = drive(Population(kind, angle, strength), dial, max(config.lengths), first)
    models = study.inferred(config, decided, source, config.lengths[0], first)
    (theirs,) = matching(
        committed.tables["populations"],
        kind=kind,
        inferred_from=source,
        spread_planted=config.spreads[1],
        episodes=config.lengths[0],
        repeat=0,
    )
    for name, value in study.population_row(models, angle, first).items():
        assert value == pytest.approx(theirs[name], rel=1e-3, abs=1e-4), name


def test_angles_are_found_where_they_differ_and_decisions_are_many(committed):
    def row(**of):
        (one,) = matching(committed.tables["pooled"], **of)
        return one

    planners = {"kind": "planner", "inferred_from": "returns"}
    many = row(**planners, spread_planted=25.0, episodes=16)
    assert many["found"] == 1.0 and many["correlation"] > 0.9
    dials = {"kind": "dial", "inferred_from": "another dial"}
    of_dials = row(**dials, spread_planted=25.0, episodes=16)
    assert of_dials["found"] == of_dials["beats_every_rival"] == 0.8
    for episodes in (2, 16):
        assert row(**planners, spread_planted=0.0, episodes=episodes)["found"] == 0.0
        alike = row(**dials, spread_planted=0.0, episodes=episodes)
        assert alike["beats_every_rival"] == 0.0

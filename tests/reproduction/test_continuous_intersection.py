"""Committed results of continuous actions at the intersection: a small part, made again."""

import numpy as np
import pytest

from socialiq import results_folder as store
from socialiq.evaluation.episodes import episodes_of, outcome_row, reward_row
from socialiq.storage import packaged_results
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.options import ContinuousOptions
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.intersection.driving import BATCH
from socialiq_lab.tables import matching


def test_an_expert_of_the_continuous_atlas_drives_as_before():
    results = store.load(packaged_results() / "intersection-continuous")
    first, episodes = results.config["first_episode"], results.config["episodes"]
    batch = Intersection(ContinuousOptions()).batch(BATCH)
    driver = atlas.load_continuous("expert_prosocial")
    again = episodes_of(batch, driver, np.arange(first, first + episodes))
    (theirs,) = matching(results.tables["policies"], name="expert prosocial")
    found = outcome_row(again) | reward_row(again)
    for outcome in ("collision", "arrival", "timeout"):
        assert found[outcome] == pytest.approx(theirs[outcome], abs=5 / episodes)
    for signal in ("r_env", "r_social"):
        assert found[signal] == pytest.approx(theirs[signal], abs=0.02)

"""LunarLander of the study classic-control; needs Box2D."""

import numpy as np
import pytest

from studies.classic_control import runs
from studies.classic_control.tasks import TASKS, returns

pytest.importorskip("Box2D")
LANDER = TASKS["LunarLander"]


def test_our_expert_lands() -> None:
    """200 is Gymnasium's threshold of a solved environment."""
    assert returns(LANDER, LANDER.expert.act, 8, 60_000_000).min() > 200


def test_what_is_kept_of_a_flight() -> None:
    shown = runs.trajectories(LANDER, 1, 50_000_000)
    kept = runs.thinned(shown, "rows", LANDER, 0, True)
    assert kept.terminated.sum() == 2  # the landing and its image
    half = kept.n_transitions // 2
    images = LANDER.symmetry.image(kept.observation[:half])
    np.testing.assert_array_equal(kept.observation[half:], images)

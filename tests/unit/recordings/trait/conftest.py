"""Simulated choices of drivers whose angles are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import log_softmax, softmax

from socialiq_recordings.prediction.choices import ChoiceTable


@pytest.fixture(scope="session")
def choices():
    """Drivers of given angles, each with the same number of decisions, in chains of `together`."""

    def make(angles, each=12, strength=2.0, seed=0, together=1, candidates=7):
        rng, drivers = np.random.default_rng(seed), len(angles)
        count, grid = drivers * each, np.linspace(-2.0, 2.0, candidates)
        driver = np.repeat(np.arange(drivers), each)

        def reward():
            line, bend = rng.normal(0, 0.5, (count, 1)), rng.normal(0, 0.3, (count, 1))
            return line * grid + bend * grid**2

        env, social = reward(), reward()
        base = log_softmax(-0.5 * grid**2 * np.ones((count, 1)), axis=1)
        radians = np.radians(np.asarray(angles, np.float64))[driver, None]
        score = strength * (np.cos(radians) * env + np.sin(radians) * social)
        below = softmax(base + score, axis=1).cumsum(axis=1)
        chosen = (below < rng.random((count, 1)) * below[:, -1:]).sum(axis=1)
        return ChoiceTable(
            driver=driver,
            chain=driver // together,
            time=np.tile(np.arange(each, dtype=np.float64), drivers),
            half=np.tile((np.arange(each) >= each // 2).astype(np.int64), drivers),
            conflict=np.ones(count, bool),
            grid=grid,
            log_base=base,
            r_env=env,
            r_social=social,
            acceleration=grid[chosen],
            residual=np.zeros(count),
        )

    return make

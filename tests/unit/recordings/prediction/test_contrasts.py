from collections.abc import Callable

import numpy as np
import pytest

from socialiq_recordings.prediction.scores import EXTENDED, Held, Predicted, contrasts
from socialiq_recordings.prediction.situations import Situations
from socialiq_recordings.prediction.study import ALL_MODELS

Make = Callable[..., Situations]


def _held(situations: Make, holdout: str, chains: int, **gains: float) -> Held:
    """Two moments of each chain, one of a first half; gains over constant speed, nats."""
    count = 2 * chains
    rng = np.random.default_rng(0)
    base = rng.normal(0, 0.1, count)
    models = [
        Predicted(name, False, base + gain, np.zeros(count), np.zeros(count))
        for name, gain in {"constant speed": 0.0, **gains}.items()
    ]
    second = np.tile([False, True], chains)
    chain = np.repeat(np.arange(chains), 2)
    moments = situations(count, acceleration=base, driven=base, chain=chain, vehicle=chain)
    return Held(holdout, moments, second, models)


def test_every_holdout_and_kind_of_moment_is_corrected_together(situations: Make) -> None:
    vehicles = _held(situations, "vehicles", 8, clone=0.3, dial=0.5)
    rows = contrasts([vehicles, _held(situations, "sites", 8, clone=0.0)], 0, 500)
    by = {(r["holdout"], r["moments"], r["model"], r["over"]): r for r in rows}
    assert len(by) == len(rows) == 8  # all and moving: three of vehicles, one of sites
    better = by["vehicles", "moving", "clone", "constant speed"]
    assert better["gain"] == pytest.approx(0.3) and better["n"] == better["chains"] == 8
    assert better["p"] == better["p_corrected"] == 2 / 2**8 and better["found"]
    assert by["vehicles", "all", "dial", "clone"]["gain"] == pytest.approx(0.2)
    same = by["sites", "moving", "clone", "constant speed"]
    assert same["p_corrected"] == 1.0 and not same["found"]


def test_few_chains_find_nothing(situations: Make) -> None:
    (row, _) = contrasts([_held(situations, "vehicles", 5, clone=3.0)], 0, 500)
    assert row["p_corrected"] == 2 / 2**5 and not row["found"]


def test_models_that_extend_others_are_known() -> None:
    assert {*EXTENDED, *EXTENDED.values()} <= set(ALL_MODELS)

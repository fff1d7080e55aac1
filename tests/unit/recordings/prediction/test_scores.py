from collections.abc import Callable

import numpy as np
import pytest

from socialiq_recordings.prediction.scores import Held, Predicted, scores
from socialiq_recordings.prediction.situations import Situations

Make = Callable[..., Situations]


def _tested(situations: Make, personal: bool = False) -> Held:
    acceleration = np.array([1.0, -1.0, 2.0, 0.0])
    models = [
        Predicted("constant speed", False, np.full(4, -1.0), np.zeros(4), np.full(4, 10.0)),
        Predicted("model", personal, np.full(4, -0.5), acceleration - 0.5, np.full(4, 12.0)),
    ]
    moments = situations(
        4,
        acceleration=acceleration,
        driven=[11.0, np.nan, 13.0, np.nan],
        chain=[0, 0, 1, 1],
        vehicle=np.arange(4),
        speed=[5.0, 5.0, 5.0, 0.0],
        to_area=[20.0, np.inf, np.inf, np.inf],
    )
    return Held("vehicles", moments, np.array([False, True, True, True]), models)


def test_scores_by_hand(situations: Make) -> None:
    rows = {(r["moments"], r["part"], r["model"]): r for r in scores(_tested(situations), 0, 200)}
    one = rows["all", "all", "model"]
    assert one["surprise"] == pytest.approx(0.5)
    assert one["rmse"] == pytest.approx(0.5)
    assert one["displacement"] == pytest.approx(1.0)
    assert (one["n"], one["n_displacement"], one["chains"]) == (4, 2, 2)
    assert (one["over"], one["gain"]) == ("constant speed", pytest.approx(0.5))
    trivial = rows["moving", "second half", "constant speed"]
    assert trivial["rmse"] == pytest.approx(np.sqrt(2.5))
    assert trivial["gain"] == 0.0
    assert rows["conflict", "all", "model"]["n"] == 1
    assert ("conflict", "second half", "model") not in rows  # no such moment


def test_who_learned_from_first_halves_is_only_scored_on_second_halves(situations: Make) -> None:
    rows = scores(_tested(situations, personal=True), 0, 200)
    assert {row["part"] for row in rows if row["model"] == "model"} == {"second half"}

import numpy as np
import pytest

from socialiq_recordings.prediction.scores import Held, Predicted, scores


def _tested(personal: bool = False) -> Held:
    acceleration = np.array([1.0, -1.0, 2.0, 0.0])
    models = [
        Predicted("constant speed", False, np.full(4, -1.0), np.zeros(4), np.full(4, 10.0)),
        Predicted("model", personal, np.full(4, -0.5), acceleration - 0.5, np.full(4, 12.0)),
    ]
    driven = np.array([11.0, np.nan, 13.0, np.nan])
    moving = np.array([True, True, True, False])
    conflict = np.array([True, False, False, False])
    second = np.array([False, True, True, True])
    return Held(
        "vehicles",
        acceleration,
        driven,
        np.array([0, 0, 1, 1]),
        np.arange(4),
        moving,
        conflict,
        second,
        models,
    )


def test_scores_by_hand() -> None:
    rows = {(r["moments"], r["part"], r["model"]): r for r in scores(_tested(), 0, 200)}
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


def test_who_learned_from_first_halves_is_only_scored_on_second_halves() -> None:
    rows = scores(_tested(personal=True), 0, 200)
    assert {row["part"] for row in rows if row["model"] == "model"} == {"second half"}

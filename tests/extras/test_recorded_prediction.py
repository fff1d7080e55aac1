"""Situations of hand-made traffic with known answers, and predictions of the recorded scenarios.

The crossing is that of `test_recorded_conflicts`: two lanes meet in the origin at right angles.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")
pytest.importorskip("sklearn", reason="extra `prediction` is not installed")

from tests.extras.test_recorded_conflicts import EDGE, east, north, recording, steady

from socialiq.cli.main import main
from socialiq.results_folder import load
from socialiq_recordings import files
from socialiq_recordings.identity.identify import identify
from socialiq_recordings.prediction import study
from socialiq_recordings.prediction.models import TRIVIAL
from socialiq_recordings.prediction.situations import clocks_of, situations_of
from socialiq_recordings.readers import import_file

FOLDER = os.environ.get("SOCIALIQ_COMMONROAD_DATA", "")
RESULTS = Path(__file__).parents[2] / "results" / "recordings-prediction"


def seen_in(*driven):
    made = [recording(*driven)]
    return situations_of(made, identify(made))


def test_situations_of_a_crossing_by_hand():
    # At 10 m/s from 42 and 45 m before the origin; EDGE m from it the front is at the area.
    seen = seen_in(east(-42, steady(10, 60)), north(-45, steady(10, 60)))
    one = seen.rows(seen.vehicle == seen.vehicle[0])
    assert one.time == pytest.approx(np.arange(5.0))
    assert np.isnan(one.last[0]) and one.last[1:] == pytest.approx(np.zeros(4))
    assert one.conflict.tolist() == [True, True, True, True, True]
    assert one.to_area == pytest.approx(42 - EDGE - 10 * np.arange(5.0))
    assert one.other_to_area == pytest.approx(45 - EDGE - 10 * np.arange(5.0))
    assert one.through == pytest.approx(np.full(5, 2 * EDGE))
    assert not one.merging.any()
    assert one.driven[:3] == pytest.approx(np.full(3, 30.0)) and np.isnan(one.driven[3:]).all()
    assert np.isinf(one.gap).all()


def test_a_leader_is_seen_and_standing_vehicles_are_in_no_conflict():
    cars = east(-60, steady(10, 40)), east(-40, steady(8, 40)), north(-20, steady(0, 40))
    seen = seen_in(*cars)
    first = seen.rows(seen.vehicle == 0)
    assert first.gap == pytest.approx(16 - 2 * np.arange(3.0))
    assert first.leader_speed == pytest.approx(np.full(3, 8.0))
    assert not seen.conflict.any()
    assert seen.rows(seen.vehicle == 1).behind == pytest.approx(16 - 2 * np.arange(3.0))


def test_what_the_driver_did_next_is_no_part_of_what_is_known():
    slows = np.interp(np.arange(60) * 0.1, [0, 2, 4, 6], [10, 10, 4, 4])
    same = steady(10, 60)
    one, two = (seen_in(east(-42, speed), north(-75, steady(10, 60))) for speed in (slows, same))
    known = [name for name in vars(one) if name not in ("acceleration", "driven")]
    rows = one.vehicle == 0
    before = rows & (one.time <= 2.0)
    for name in known:
        if name not in ("to_junction", "turn"):  # along the route, which is taken as known
            assert getattr(one, name)[before] == pytest.approx(
                getattr(two, name)[before], nan_ok=True
            ), name


def test_a_batch_without_enough_moments_ends_in_one_line(tmp_path, capsys):
    made = recording(east(-30, steady(10, 30)), north(-50, steady(10, 30)))
    files.save(tmp_path / "small.safetensors", made)
    assert main(["data", "predict", str(tmp_path / "small.safetensors")]) == 2
    assert "moments to learn from" in capsys.readouterr().err
    short = recording(east(-30, steady(10, 5)))
    files.save(tmp_path / "short.safetensors", short)
    assert main(["data", "predict", str(tmp_path / "short.safetensors")]) == 2
    assert "no vehicle is on the road for a second" in capsys.readouterr().err


@pytest.fixture(scope="module")
def twelve():
    if not FOLDER:
        pytest.skip("SOCIALIQ_COMMONROAD_DATA is not set")
    return [import_file(path)[0].recording for path in sorted(Path(FOLDER).glob("USA_*.xml"))]


@pytest.mark.recorded
def test_a_part_of_the_published_prediction_is_made_again(twelve):
    published = load(RESULTS)
    identified = identify(twelve)
    seen = situations_of(twelve, identified)
    assert len(seen) == published.summary["moments"]
    names = (*TRIVIAL, "IDM, literature", "IDM, fitted")
    config = study.Config(("vehicles",), names, seed=published.config["prediction"]["seed"])
    again = study.predict(seen, config).scores
    rows = {
        (row["moments"], row["part"], row["model"]): row
        for row in published.tables["scores"]
        if row["holdout"] == "vehicles"
    }
    for row in again:
        one = rows[row["moments"], row["part"], row["model"]]
        for name in ("n", "chains", "surprise", "rmse", "displacement", "gain_low"):
            assert one[name] == pytest.approx(row[name], rel=1e-3, abs=1e-4), (row, name)


@pytest.mark.recorded
def test_overlapping_recordings_share_a_clock_and_no_moment_counts_twice(twelve):
    identified = identify(twelve)
    clocks = dict(zip(identified.names, clocks_of(identified), strict=True))
    apart = clocks["USA_Lanker-2_2_T-1"] - clocks["USA_Lanker-2_16_T-1"]
    assert abs(apart) == pytest.approx(7.5, abs=0.2)
    seen = situations_of(twelve, identified)
    assert len(situations_of(twelve, identified, drop=False)) > len(seen)
    pairs = list(
        zip(seen.vehicle.tolist(), seen.recording.tolist(), seen.time.round(1), strict=True)
    )
    assert len(set(pairs)) == len(pairs)


def test_the_command_writes_tables_and_a_picture(tmp_path, capsys):
    rng = np.random.default_rng(0)
    cars = []
    for number in range(12):
        speed = 8 + np.cumsum(rng.normal(0, 0.15, 80))
        make = east if number % 2 else north
        cars.append(make(-75.0 + 12 * (number // 2), speed))
    files.save(tmp_path / "made.safetensors", recording(*cars))
    call = ["data", "predict", str(tmp_path / "made.safetensors"), "--models", "boosting"]
    assert main([*call, "--holdout", "moments", "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {row["model"] for row in printed["scores"]} == {*TRIVIAL, "boosting"}
    assert (tmp_path / "out" / "gains.png").is_file()
    assert load(tmp_path / "out").config["prediction"]["holdouts"] == ["moments"]
    assert main([*call, "--holdout", "sites"]) == 2
    assert "show one site" in capsys.readouterr().err
    assert main([*call[:-1], "perceptron"]) == 2
    assert "unknown model 'perceptron': choose from 'constant speed'" in capsys.readouterr().err

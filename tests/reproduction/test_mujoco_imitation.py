"""The committed tables of `mujoco-imitation` are those of the committed pieces."""

import json
from pathlib import Path

import pytest

from socialiq import results_folder as store
from socialiq.storage import packaged_results
from socialiq.to_json import rounded
from socialiq_lab.registry import find
from socialiq_lab.study import Context
from studies.mujoco_imitation.study import FOLDER, compute_tables

Config = find("mujoco-imitation").Config
FOLDER_OF_STUDY = packaged_results() / "mujoco-imitation"


def test_tables_follow_from_the_pieces():
    committed = store.load(FOLDER_OF_STUDY)
    config = Config(pieces=str(FOLDER_OF_STUDY), new=False)
    found = compute_tables(config, Context((), Path(), lambda _stage: None))
    assert {name for name, rows in found.tables.items() if rows} == set(committed.tables)
    for name, rows in committed.tables.items():
        wanted = rounded(found.tables[name])
        assert len(rows) == len(wanted)
        for row, one in zip(rows, wanted, strict=True):
            numbers = {key: value for key, value in one.items() if isinstance(value, float)}
            assert {key: row[key] for key in one.keys() - numbers} == {
                key: one[key] for key in one.keys() - numbers
            }
            assert {key: row[key] for key in numbers} == pytest.approx(numbers)


def test_pieces_have_the_seeds_and_settings_of_the_plan():
    """No run is of a development seed, and runs of a method share their settings."""
    settings: dict = {}
    for path in (FOLDER_OF_STUDY / FOLDER).glob("*-*.json"):
        piece = json.loads(path.read_text())
        assert piece["seed"] in Config.seeds and piece["evaluation_seed"] == Config.evaluation_seed
        assert len(piece["returns"]) == Config.episodes
        record = piece["record"]
        key = (piece["task"], piece["method"])
        later = {"times": 0}, {"actor_rate": 1.0}  # later fields, at their defaults
        structure, numbers = later[0] | record["structure"], later[1] | record["numbers"]
        numbers = {k: v for k, v in numbers.items() if k not in ("seed", "dataset")}
        assert settings.setdefault(key, (structure, numbers)) == (structure, numbers)
    assert settings

"""Each study runs end to end at a tiny size: the tables, the summary, and the figures from them."""

import importlib

import pytest

from socialiq.cli.studies import STUDIES
from socialiq.experiments import results as store
from socialiq.plotting.style import png

TINY = {
    "worlds": {"episodes": 20},
    "poc": {"seeds": (0,), "updates": 20, "readings": False},
    "grid": {
        "seeds": (0, 1),
        "updates": 20,
        "episodes_each": 3,
        "transitions_each": 30,
        "target_kinds": ("running",),
        "strengths": (2.0,),
    },
    "lambda-sweep": {
        "seeds": (0, 1),
        "updates": 20,
        "checkpoint_every": 10,
        "episodes_each": 3,
        "strengths": (0.0, 5.0),
        "target_kinds": ("instantaneous",),
    },
    "alternatives": {"seeds": (0,), "updates": 10, "episodes_each": 3, "strengths": (1.0,)},
    "theory": {
        "seeds": (0,),
        "updates": 20,
        "episodes_each": 3,
        "angles": (0.0,),
        "random_worlds": 1,
        "target_kinds": ("instantaneous",),
        "units": (0.2, 0.8),
        "lengths": (0.0, 1.0),
    },
    "dial": {
        "seeds": (0,),
        "updates": 20,
        "episodes_each": 3,
        "runs": ("offline",),
        "budgets": (0.5,),
        "budget_seeds": (0,),
        "wanted": (0.0, 45.0, 90.0),
        "rollouts": 5,
    },
    "competence": {
        "seeds": (0,),
        "episodes_each": 3,
        "angles": (0.0, 30.0),
        "strengths": (1.0,),
        "grid": 45,
        "tolerance": 1e-2,
    },
    "audits": {
        "episodes": 20,
        "updates": 20,
        "dial_updates": 20,
        "dial_angles": (0.0, 90.0),
        "worlds": ("crossing7",),
    },
    "audit-power": {"episodes": 60, "replications": 4, "resamples": 100},
    "classic-control": {"seeds": (0,), "tasks": ("CartPole",), "episodes": 1},
}


@pytest.fixture(scope="module", params=list(TINY))
def study(request):
    if request.param == "classic-control":
        import dataclasses

        module = importlib.import_module("socialiq.studies.classic_control.study")
        module.STRUCTURE = dataclasses.replace(module.STRUCTURE, updates=20)
    module = STUDIES[request.param].module
    return request.param, module.run(module.Config(**TINY[request.param]))


def test_results_are_saved_and_read_back(study, tmp_path):
    name, results = study
    store.save(results, tmp_path / name, png(STUDIES[name].draw(results)), replace=False)
    read = store.load(tmp_path / name)
    assert read.summary == results.summary
    assert read.tables.keys() == results.tables.keys()


def test_figures_come_from_the_csv_alone(study, tmp_path):
    name, results = study
    store.save(results, tmp_path / name, {}, replace=False)
    drawn = png(STUDIES[name].draw(store.load(tmp_path / name)))
    assert drawn and all(picture.startswith(b"\x89PNG") for picture in drawn.values())


def test_the_printed_table_exists(study):
    name, results = study
    assert results.tables[STUDIES[name].main_table]


@pytest.mark.parametrize(
    ("near", "settled"),
    [
        ([True, True, True], 10),
        ([False, True, True], 20),
        ([True, False, True], 30),
        ([True, True, False], ""),
        ([False, False, False], ""),
    ],
)
def test_a_lane_settles_where_it_stays(near, settled):
    from socialiq.studies.lambda_sweep.study import _settled

    assert _settled([10, 20, 30], near) == settled

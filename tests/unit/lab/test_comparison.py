"""Comparisons: declared methods and recipes, choice on development seeds, means, the figure."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.exact import Metrics
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import config as presets
from socialiq.results_folder import Results
from socialiq_lab import comparison, comparison_jobs, comparison_tables
from socialiq_lab.comparison_runs import Arena, Run, in_programs, runs_of, trained
from socialiq_lab.tables import pooled as pooled_of

METHODS = comparison.declared_methods(
    {
        "method": {
            "clone": {"label": "BC", "grid": {"learning_rate": [0.1, 0.3]}, "serves": "all"},
            "of_mode": {"label": "BC of the nearest", "learner": "clone", "serves": "mode"},
            "rl": {"label": "RL", "soft": False, "worlds": ["crossing5"], "told": ["rewards"]},
        }
    }
)


def test_a_method_is_declared_by_its_table():
    clone, of_mode, rl = METHODS.values()
    assert (clone.learner, of_mode.learner) == ("clone", "clone")
    assert clone.settings == ((("learning_rate", 0.1),), (("learning_rate", 0.3),))
    assert of_mode.of_mode and not clone.of_mode and of_mode.settings == ()
    assert rl.worlds == ("crossing5",) and rl.told == ("rewards",)
    assert (clone.readouts, rl.readouts) == (("greedy", "soft"), ("greedy",))
    assert clone.setting_of("learning_rate 0.3") == clone.settings[1]


def test_a_network_serves_angles_modes_or_all():
    angles = (0.0, 20.0, 40.0, 80.0)
    clone, of_mode, rl = METHODS.values()
    assert clone.served(angles) == {0.0: angles}
    assert rl.served(angles) == {angle: (angle,) for angle in angles}
    assert of_mode.served(angles) == {0.0: (0.0, 20.0), 45.0: (40.0,), 90.0: (80.0,)}
    assert of_mode.served((80.0,)) == {90.0: (80.0,)}


@dataclasses.dataclass(frozen=True)
class Own(comparison.Recipe):
    mirrored: bool = False


def test_recipes_are_changes_of_those_before_them():
    offline = iq.IQLearnConfig(online=False, value_term="value_expert")
    bases = {"preset": Own(offline, iq.IQLearnHyperparameters())}
    recipes = comparison.declared_recipes(
        {
            "first": {"of": "preset", "static": {"updates": 7}, "mirrored": True},
            "second": {"of": "first", "numbers": {"temperature": 0.5}},
            "third": {"of": "second", "static": {"endings": {"timeout": "bootstrap"}}},
        },
        bases,
    )
    assert list(recipes) == ["first", "second", "third"]
    assert recipes["first"].static.updates == recipes["third"].static.updates == 7
    assert recipes["third"].numbers.temperature == 0.5 and recipes["third"].mirrored
    assert recipes["third"].static.endings == iq.Endings(timeout="bootstrap")
    assert bases["preset"].static.updates != 7 and not recipes["first"].online
    with pytest.raises(UserError, match="no setting tempo"):
        comparison.declared_recipes({"wrong": {"of": "preset", "numbers": {"tempo": 1}}}, bases)


def config_of(**changes) -> SimpleNamespace:
    fields = {
        "worlds": ("crossing5",),
        "methods": ("clone",),
        "angles": (0.0, 90.0),
        "development_angles": (45.0,),
        "development_seeds": (1,),
        "seeds": (2, 3),
        "learning_rate": 0.01,
        "polyak": 0.1,
    }
    return SimpleNamespace(**fields | changes)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"worlds": ("mars",)}, "unknown world 'mars'"),
        ({"methods": ("luck",)}, "unknown method 'luck'"),
        ({"angles": ()}, "angles must name at least one"),
        ({"worlds": ("crossing5", "crossing5")}, "named twice"),
        ({"seeds": (1, 2)}, "a seed of development can't be a seed of the table"),
    ],
)
def test_wrong_choices_are_one_line(changes, line):
    assert comparison.cells_of(config_of(), METHODS) == [("crossing5", METHODS["clone"])]
    with pytest.raises(UserError, match=line):
        comparison.cells_of(config_of(**changes), METHODS)


def test_phases_have_their_own_seeds_and_angles():
    method = METHODS["clone"]
    runs = [
        comparison_jobs.GridRuns.of(config_of(), phase, "crossing5", method, method.settings, 9)
        for phase in (comparison.DEVELOPMENT, comparison.FRESH)
    ]
    assert [(run.seeds, run.angles) for run in runs] == [((1,), (45.0,)), ((2, 3), (0.0, 90.0))]
    assert {(run.learning_rate, run.polyak, run.updates) for run in runs} == {(0.01, 0.1, 9)}


def test_a_seed_has_its_own_data_set_in_every_setting():
    settings = METHODS["clone"].settings
    runs = runs_of(settings, (0.0, 90.0), (5, 6))
    assert len(runs) == 8
    assert {(run.seed, run.dataset) for run in runs} == {(5, 0), (6, 1)}
    assert [run.setting for run in runs] == [settings[0]] * 4 + [settings[1]] * 4


def test_settings_of_a_run_come_before_the_methods_and_the_worlds():
    arena = Arena(presets.TABLE_C1, presets.TABLE_C1_NUMBERS, 11, [])
    kinds = bc.CloningConfig, bc.CloningHyperparameters
    run = Run(30.0, 4, 1, (("reweight_temperature", 0.25),))
    static, numbers = arena.settings(*kinds, run, weighted=True, reweight_temperature=9.0)
    assert static.updates == 11 and static.weighted and static.hidden == arena.structure.hidden
    assert (numbers.angle, numbers.seed, numbers.dataset) == (30.0, 4, 1)
    assert numbers.reweight_temperature == 0.25
    assert numbers.learning_rate == arena.numbers.learning_rate


def test_runs_of_one_static_config_share_a_program():
    programs = []

    def train(static, numbers):
        programs.append((static, numbers))
        return SimpleNamespace(policy=lambda run: f"{static}{numbers[run]}")

    settings = [("a", 1), ("b", 2), ("a", 3)]
    assert in_programs(settings, train) == ["a1", "b2", "a3"]
    assert programs == [("a", [1, 3]), ("b", [2])]


def test_a_method_of_a_mode_learns_from_each_mode_alone(monkeypatch):
    monkeypatch.setattr(Arena, "of_each_mode", lambda arena, runs: ("of modes", runs[::-1]))
    arena, runs = Arena(None, None, 1, []), [Run(angle, 0, 0, ()) for angle in (0.0, 90.0)]
    of_modes = trained(lambda *inputs: [inputs], arena, METHODS["of_mode"], runs)
    assert of_modes == [("of modes", runs[::-1])]
    assert trained(lambda *inputs: [inputs], arena, METHODS["clone"], runs) == [(arena, runs)]


def row(method: str, setting: str, angle: float, seed: int, value: float, regret=0.0) -> dict:
    totals = dict.fromkeys(Metrics._fields, 0.0) | {"r_env": value, "r_social": 1.0}
    label = {"world": "w", "method": method, "setting": setting, "target_angle": angle}
    return label | {"readout": "greedy", "seed": seed} | totals | {"value": value, "regret": regret}


def test_development_chooses_by_the_mean_and_the_first_of_equal_ones():
    rows = [
        row("m", "a", 0.0, 1, 1.0),
        row("m", "a", 90.0, 1, 3.0),
        row("m", "b", 0.0, 1, 2.0 + 1e-12),
        row("m", "b", 90.0, 1, 2.0),
        row("n", "a", 0.0, 1, -1.0),
        row("n", "b", 0.0, 1, -0.5),
    ]
    assert comparison_tables.choose(rows, "setting") == {("w", "m"): "a", ("w", "n"): "b"}


KEYS = ("world", "method", "setting", "target_angle", "readout")
QUANTITIES = ("value", "regret")


def test_means_are_over_seeds_and_their_range_is_of_single_seeds():
    rows = [row("m", "a", 0.0, 1, 1.0, 0.5), row("m", "a", 0.0, 2, 2.0, 1.5)]
    (pooled,) = pooled_of(rows, KEYS, QUANTITIES, ("seed",))
    assert (pooled["seeds"], pooled["value"], pooled["seed"]) == (2, 1.5, 1.5)
    assert (pooled["value_low"], pooled["value_high"]) == (1.0, 2.0)
    assert (pooled["regret"], pooled["regret_low"], pooled["regret_high"]) == (1.0, 0.5, 1.5)
    # α̂ is that of the mean totals (1.5, 1).
    assert pooled["angle"] == pytest.approx(np.degrees(np.arctan2(1.0, 1.5)))


def test_without_an_optimum_there_is_no_regret():
    rows = [row("m", "a", angle, 1, 1.0 + angle, "") for angle in (0.0, 90.0)]
    pooled = pooled_of(rows, KEYS, QUANTITIES, ())
    assert {one["regret_low"] for one in pooled} == {""}
    (overall,) = comparison_tables.overall(pooled, ("world", "method"))
    assert (overall["value"], overall["regret"], overall["worst_regret"]) == (46.0, "", "")
    results = Results.of("x", iq.IQLearnHyperparameters(), {"pooled": pooled}, {})
    assert comparison_tables.quantity(results, "w") == "value"


def test_the_worst_regret_is_that_of_the_worst_angle():
    rows = [row("m", "a", angle, 1, 0.0, regret) for angle, regret in ((0.0, 1.0), (90.0, 4.0))]
    pooled = pooled_of(rows, KEYS, QUANTITIES, ())
    (overall,) = comparison_tables.overall(pooled, ("world", "method"))
    assert (overall["angles"], overall["regret"], overall["worst_regret"]) == (2, 2.5, 4.0)


def test_a_field_shows_the_mean_and_the_range_where_seeds_differ():
    rows = [row("m", "a", 0.0, seed, 0.0, regret) for seed, regret in ((1, 0.25), (2, 0.75))]
    rows += [row("m", "a", 90.0, seed, 0.0, 0.0) for seed in (1, 2)]
    config = iq.IQLearnHyperparameters()
    results = Results.of("x", config, {"pooled": pooled_of(rows, KEYS, QUANTITIES, ())}, {})
    picture = comparison_tables.angle_figure(results, "w", {"m": "label of m"}, ("greedy",))
    axes = picture.axes[0]
    assert [text.get_text() for text in axes.texts] == ["0.50\n0.25 to 0.75", "0"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["label of m"]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0", "90"]

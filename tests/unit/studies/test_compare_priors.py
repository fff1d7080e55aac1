"""The comparison of priors: each method at a tiny size, the choice of λ, the whole run."""

import numpy as np
import pytest

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import MODES, trajectory_datasets
from socialiq.learners.collect import from_env
from socialiq.learners.iq_learn import config as presets
from socialiq.plotting.style import png
from socialiq.worlds.gym import GridWorldEnv
from socialiq_lab.comparison import nearest_mode
from socialiq_lab.comparison_runs import Arena, Run
from socialiq_lab.comparison_tables import chances, choose
from socialiq_lab.registry import find
from socialiq_lab.study import run
from studies.compare_priors import study
from studies.compare_priors.study import LEARNERS, METHODS, effective_share

STUDY = find("compare-priors")
Config = STUDY.Config

TINY = Config(
    worlds=("crossing5",),
    methods=("none", "clone_of_mode", "clone_weighted", "rl"),
    angles=(0.0, 30.0, 90.0),
    development_angles=(0.0,),
    strengths=(1.0, 3.0),
    development_seeds=(0,),
    seeds=(10, 11),
    updates=10,
)


@pytest.fixture(name="arena", scope="module")
def five_by_five():
    ground = Ground.of("crossing5")
    datasets = trajectory_datasets(ground.table, (0, 1), 2)
    return Arena(
        presets.TABLE_C1,
        presets.TABLE_C1_NUMBERS,
        10,
        datasets,
        ground.table.world,
        lambda steps: from_env(GridWorldEnv("crossing5"), steps),
    )


def run_at(angle: float, strength: float, number: int = 0) -> Run:
    return Run(angle, number, number, (("strength", strength),))


QUICK = ("clone", "cql")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow)
        for name in ("advantage", "dial", "clone", "clone_of_mode", "clone_weighted", "cql", "rl")
    ],
)
def test_every_learner_trains_a_policy_for_each_run(arena, name):
    method, ground = METHODS[name], Ground.of("crossing5")
    runs = [run_at(0.0, 1.0), run_at(90.0, 3.0, 1)]
    policies = study.train(arena, method, runs)
    tables = [chances(ground, policy, 45.0, "soft") for policy in policies]
    assert len(policies) == 2 and not np.allclose(tables[0], tables[1])
    for policy, given in zip(policies, runs, strict=True):
        assert policy.provenance["numbers"]["seed"] == given.seed
        structure = policy.provenance["structure"]
        assert tuple(structure["hidden"]) == arena.structure.hidden
        rows = structure.get("batch_size", structure.get("expert_batch"))
        assert rows == arena.structure.batch_size
        assert policy.provenance["numbers"]["learning_rate"] == arena.numbers.learning_rate


def test_rows_of_a_table_have_distinct_names_and_learners():
    assert len(METHODS) == len({method.label for method in METHODS.values()})
    assert {method.learner for method in METHODS.values()} == set(study.SCALES) <= set(LEARNERS)


@pytest.mark.parametrize(
    ("angle", "mode"),
    [(0.0, "egoistic"), (22.5, "egoistic"), (30.0, "prosocial"), (75.0, "altruistic")],
)
def test_the_nearest_mode(angle, mode):
    assert nearest_mode(angle) == mode


def test_the_share_of_the_data_that_counts(arena):
    """Of the transitions GGGG, WGGGG, WWWWGGGG of each set the egoist has 4 of 17."""
    shares = {
        name: effective_share(arena, METHODS[name], run_at(0.0, 1.0))
        for name in ("none", "clone", "clone_of_mode", "clone_weighted", "reweighting", "rl")
    }
    assert shares["none"] == shares["clone"] == 1.0
    assert shares["clone_of_mode"] == pytest.approx(4 / 17)
    assert shares["rl"] == 0.0
    for name in ("clone_weighted", "reweighting"):
        assert 0.0 < shares[name] < 1.0
        mild = effective_share(arena, METHODS[name], run_at(0.0, 1e-6))
        assert mild == pytest.approx(1.0, abs=1e-4)


def test_the_strength_with_the_greatest_mean_value_is_chosen():
    rows = [
        {"world": "w", "method": "m", "strength": strength, "value": value}
        for strength, value in [(1.0, 3.0), (1.0, 1.0), (3.0, 2.0), (3.0, 2.5), (10.0, 2.25)]
    ]
    assert choose(rows, "strength") == {("w", "m"): 3.0}
    tied = [row | {"value": 2.25} for row in rows if row["strength"] != 1.0]
    assert choose(tied, "strength") == {("w", "m"): 3.0}
    assert choose([], "strength") == {}


def test_every_policy_has_a_row_for_each_angle_and_readout(results):
    rows = results.tables["policies"]
    for name, readouts in (("none", 2), ("clone_of_mode", 2), ("clone_weighted", 2), ("rl", 1)):
        own = [row for row in rows if row["method"] == name]
        assert len(own) == len(TINY.angles) * len(TINY.seeds) * readouts
        assert all(row["regret"] >= -1e-9 for row in own)
    chosen = {row["method"]: row["strength"] for row in results.tables["chosen"]}
    assert set(chosen) == {"clone_weighted"}
    assert {r["strength"] for r in rows if r["method"] == "clone_weighted"} == {*chosen.values()}


def test_a_method_that_does_not_know_the_angle_is_one_policy(results):
    own = [r for r in results.tables["policies"] if (r["method"], r["seed"]) == ("none", 10)]
    for readout in ("greedy", "soft"):
        totals = {(r["r_env"], r["r_social"]) for r in own if r["readout"] == readout}
        assert len(totals) == 1


def test_means_and_ranges_are_over_seeds(results):
    for row in results.tables["pooled"]:
        own = [
            one["regret"]
            for one in results.tables["policies"]
            if all(one[key] == row[key] for key in study.KEYS)
        ]
        assert row["seeds"] == len(own) == 2
        assert row["regret"] == pytest.approx(np.mean(own), abs=2e-6)
        assert (row["regret_low"], row["regret_high"]) == (min(own), max(own))


def test_demonstrators_are_optimal_at_their_own_angles(results):
    rows = {row["target_angle"]: row for row in results.tables["references"]}
    assert rows[0.0]["egoistic"] == rows[90.0]["altruistic"] == 0.0
    assert rows[90.0]["egoistic"] == 10.0
    for row in rows.values():
        assert row["value_iteration"] <= min(row[mode] for mode in MODES)


def test_the_overall_table_is_over_angles(results):
    for row in results.tables["overall"]:
        own = [
            one["regret"]
            for one in results.tables["pooled"]
            if (one["method"], one["readout"]) == (row["method"], row["readout"])
        ]
        assert row["angles"] == len(own) == len(TINY.angles)
        assert row["regret"] == pytest.approx(np.mean(own), abs=2e-6)
        assert row["worst_regret"] == max(own)


def test_angle_errors_are_ranked_against_regrets():
    """Three policies whose errors rank as their regrets, and three the other way round."""

    def row(world: str, angle: float, regret: float) -> dict:
        labels = {"world": world, "readout": "greedy", "target_angle": 0.0}
        return labels | {"angle": angle, "regret": regret}

    alike = [row("a", 10.0 * n, 0.1 * n) for n in range(1, 4)]
    against = [row("b", -10.0 * n, 1.0 - 0.1 * n) for n in range(1, 4)]
    found = {r["world"]: r for r in study.alignment([*alike, *against])}
    assert set(found) == {"a", "b"}
    assert found["a"]["spearman"] == pytest.approx(1.0)
    assert found["b"]["spearman"] == pytest.approx(-1.0)
    assert found["b"]["error_at_least_regret"] == pytest.approx(30.0)
    assert found["b"]["regret_at_least_error"] == pytest.approx(0.9)
    counted = study.alignment_counts(list(found.values()))
    assert counted["groups"] == 2 and counted["least_error_has_least_regret"] == 1


def test_a_second_call_does_nothing_and_gives_the_same(results, work):
    before = {path: path.stat().st_mtime_ns for path in work.rglob("job.json")}
    assert run(STUDY, TINY, work=work).summary == results.summary
    assert {path: path.stat().st_mtime_ns for path in work.rglob("job.json")} == before


def test_results_are_saved_and_drawn_from_the_files(results, tmp_path):
    store.save(results, tmp_path / "out", {}, replace=False)
    read = store.load(tmp_path / "out")
    assert read.summary == results.summary
    drawn = png(STUDY.figures(read))
    assert list(drawn) == ["crossing5"] and drawn["crossing5"].startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"worlds": ("crossing9",)}, "unknown world 'crossing9': choose one of crossing5"),
        ({"worlds": ("crossing5", "crossing5")}, "named twice"),
        ({"methods": ("gail",)}, "unknown method 'gail'"),
        ({"seeds": ()}, "seeds must name at least one"),
        ({"seeds": (3,)}, "can't be a seed of the table"),
    ],
)
def test_a_wrong_configuration_is_refused(changed, line):
    with pytest.raises(UserError, match=line):
        study.jobs(Config(**changed))

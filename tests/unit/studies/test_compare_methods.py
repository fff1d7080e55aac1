"""The comparison of methods: each learner at a tiny size, equal tuning, what is refused."""

from pathlib import Path

import numpy as np
import pytest
from tests.digest.studies import differs

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import MODES, trajectory_datasets
from socialiq.learners.collect import from_env
from socialiq.learners.iq_learn import config as presets
from socialiq.plotting.style import png
from socialiq.worlds.gym import GridWorldEnv
from socialiq_lab import comparison_tables
from socialiq_lab.comparison import cells_of, product, setting_name
from socialiq_lab.comparison_runs import Arena, Run, trained
from socialiq_lab.jobs import fingerprints
from socialiq_lab.registry import find
from studies.compare_methods import study
from studies.compare_methods.baselines.shared import totals_of
from studies.compare_methods.learners import LEARNERS, best_episodes
from studies.compare_methods.study import ANGLES, METHODS, TOLD, updates_of

STUDY = find("compare-methods")
Config = STUDY.Config

TINY = Config(
    worlds=("crossing5",),
    methods=("clone", "clone_of_mode", "outcome_conditioned"),
    angles=(0.0, 30.0, 90.0),
    development_angles=(15.0,),
    development_seeds=(0,),
    seeds=(10, 11),
    updates=3,
)


@pytest.fixture(name="arena", scope="module")
def five_by_five() -> Arena:
    ground = Ground.of("crossing5")
    return Arena(
        presets.TABLE_C1,
        presets.TABLE_C1_NUMBERS,
        6,
        trajectory_datasets(ground.table, (0, 1), 2),
        ground.table.world,
        lambda steps: from_env(GridWorldEnv("crossing5"), steps),
    )


QUICK = ("clone", "cql", "outcome_conditioned")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(method.name, marks=[] if method.name in QUICK else pytest.mark.slow)
        for method in METHODS.values()
    ],
)
def test_every_learner_trains_a_policy_for_each_run(arena: Arena, name: str) -> None:
    method, ground = METHODS[name], Ground.of("crossing5")
    before = len(arena.rates)
    runs = [
        Run(angle, seed, seed, setting)
        for angle, seed, setting in ((0.0, 0, method.settings[0]), (90.0, 1, method.settings[-1]))
    ]
    policies = trained(LEARNERS[method.learner], arena, method, runs)
    assert len(policies) == 2 and len(arena.rates) > before
    for policy, given in zip(policies, runs, strict=True):
        table = comparison_tables.chances(ground, policy, given.angle, "soft")
        np.testing.assert_allclose(table.sum(axis=1), 1.0)


def test_every_method_has_as_many_settings_and_a_learner() -> None:
    assert {method.learner for method in METHODS.values()} == {*LEARNERS}
    for method in METHODS.values():
        assert len({setting_name(one) for one in method.settings}) == 4
        assert {*method.told} <= {*TOLD}
        assert method.setting_of(setting_name(method.settings[2])) == method.settings[2]


def test_seven_angles_have_the_same_updates_for_every_method() -> None:
    for method in METHODS.values():
        networks = len(method.served(ANGLES))
        whole = updates_of(method, 2_100) * networks
        assert whole == 7 * 2_100
        served = [angle for group in method.served(ANGLES).values() for angle in group]
        assert sorted(served) == list(ANGLES)


def test_of_a_mode_a_network_sees_only_its_episodes(arena: Arena) -> None:
    of_modes, placed = arena.of_each_mode([Run(75.0, 0, 1, ()), Run(0.0, 0, 0, ())])
    datasets = of_modes.datasets
    assert len(datasets) == len(MODES) * 2
    for run_of, mode in zip(placed, ("altruistic", "egoistic"), strict=True):
        counts = datasets[run_of.dataset].counts()
        assert [name for name, (episodes, _) in counts.items() if episodes] == [mode]


def test_the_setting_with_the_greatest_mean_value_is_chosen() -> None:
    rows = [
        {"world": "w", "method": "m", "setting": name, "readout": readout, "value": value}
        for name, readout, value in [
            ("a", "greedy", 1.0),
            ("a", "greedy", 3.0),
            ("b", "greedy", 2.5),
            ("c", "greedy", 2.5),
            ("a", "soft", 99.0),
        ]
    ]
    assert study.choose(rows) == {("w", "m"): "b"}


def test_no_table_of_the_digest_differs(results, work) -> None:
    assert differs("compare-methods", results, work) == []


def test_results_are_over_seeds_and_angles(results, tmp_path: Path) -> None:
    rows = results.tables["policies"]
    for name in TINY.methods:
        own = [row for row in rows if (row["method"], row["readout"]) == (name, "greedy")]
        assert len(own) == len(TINY.angles) * len(TINY.seeds)
        assert all(row["regret"] >= -1e-9 for row in own)
        whole = next(row for row in results.tables["overall"] if row["method"] == name)
        assert whole["regret"] == pytest.approx(np.mean([row["regret"] for row in own]), abs=2e-6)
        assert whole["updates_per_second"] > 0
        told = {one for one in TOLD if whole[one]}
        assert told == {*METHODS[name].told}
    best = {row["best"] for row in results.tables["paired"]}
    assert len(best) == 1 and len(results.tables["paired"]) == len(TINY.methods) - 1
    (view,) = STUDY.view(results)
    assert [row["mean"] for row in view.rows] == sorted(row["mean"] for row in view.rows)
    store.save(results, tmp_path / "found", png(STUDY.figures(results)), replace=False)
    assert (tmp_path / "found" / "crossing5.png").is_file()


def test_jobs_of_the_whole_comparison_have_names_of_their_own() -> None:
    config = Config()
    jobs = study.jobs(config)
    assert len(fingerprints(jobs)) == len(jobs)
    chosen = {
        (world, method.name): setting_name(method.settings[1])
        for world, method in cells_of(config, METHODS)
    }
    fresh = study.phase_jobs(config, "fresh", chosen)
    assert len(fingerprints(fresh)) == len(fresh)


@pytest.mark.parametrize(
    ("change", "mend"),
    [
        ({"worlds": ("crossing9",)}, "choose one of"),
        ({"methods": ("gale",)}, "choose one of"),
        ({"worlds": ("crossing5", "crossing5")}, "named twice"),
        ({"seeds": (100,)}, "seed of development"),
        ({"angles": ()}, "at least one"),
        ({"updates": 0}, "updates must be at least 1"),
    ],
)
def test_wrong_configurations_are_refused(change, mend) -> None:
    with pytest.raises(UserError, match=mend):
        study.jobs(Config(**change))


def test_the_best_third_is_that_of_the_angle(arena: Arena) -> None:
    data = arena.datasets[0]
    egoistic, altruistic = (best_episodes(data, angle) for angle in (0.0, 90.0))
    for best, rest_total in ((egoistic, 0), (altruistic, 1)):
        totals = totals_of(data)[:, rest_total]
        chosen = totals_of(best)[:, rest_total]
        cut = np.sort(totals)[::-1][-(-len(totals) // 3) - 1]
        assert chosen.min() == cut and len(chosen) == (totals >= cut).sum()


def test_a_grid_is_all_combinations() -> None:
    assert product(a=(1.0, 2.0), b=(3.0,)) == ((("a", 1.0), ("b", 3.0)), (("a", 2.0), ("b", 3.0)))

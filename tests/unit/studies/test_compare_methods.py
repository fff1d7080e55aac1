"""The comparison of methods: each learner at a tiny size, equal tuning, the exchange with peers."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.digest.studies import differs

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.evaluation.exact import Ground, evaluate_exactly
from socialiq.evaluation.rollout import MODES, trajectory_datasets
from socialiq.learners.collect import from_env
from socialiq.learners.iq_learn import config as presets
from socialiq.plotting.style import png
from socialiq.worlds.gym import GridWorldEnv
from socialiq.worlds.tabular_policy import expert_policy
from socialiq_lab.baselines import totals_of
from socialiq_lab.comparison import cells_of, product, setting_name
from socialiq_lab.comparison_runs import Arena, Run, best_episodes, trained
from socialiq_lab.comparison_tables import chances, rows_of
from socialiq_lab.intersection.driving import (
    RECORDED_EPISODES,
    EpisodesRun,
    atlas_demonstrations,
)
from socialiq_lab.jobs import fingerprints
from socialiq_lab.registry import find
from socialiq_lab.study import run
from studies.compare_methods import intersection, learners, study
from studies.compare_methods.intersection import METHODS
from studies.compare_methods.learners import LEARNERS
from studies.compare_methods.study import ANGLES, TOLD, updates_of

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
def five_by_five():
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
        if not method.peer
    ],
)
def test_every_learner_trains_a_policy_for_each_run(arena, name):
    method, ground = METHODS[name], Ground.of("crossing5")
    before = len(arena.rates)
    runs = [
        Run(angle, seed, seed, setting)
        for angle, seed, setting in ((0.0, 0, method.settings[0]), (90.0, 1, method.settings[-1]))
    ]
    policies = trained(LEARNERS[method.learner], arena, method, runs)
    assert len(policies) == 2 and len(arena.rates) > before
    for policy, given in zip(policies, runs, strict=True):
        table = chances(ground, policy, given.angle, "soft")
        np.testing.assert_allclose(table.sum(axis=1), 1.0)


def test_every_method_has_as_many_settings_and_a_learner():
    ours = [method for method in METHODS.values() if not method.peer]
    assert {method.learner for method in ours} == {*LEARNERS}
    for method in METHODS.values():
        assert len({setting_name(one) for one in method.settings}) == 4
        assert {*method.told} <= {*TOLD}
        assert method.setting_of(setting_name(method.settings[2])) == method.settings[2]


def test_seven_angles_have_the_same_updates_for_every_method():
    for method in METHODS.values():
        networks = len(method.served(ANGLES))
        whole = updates_of(method, 2_100) * networks
        assert whole == 7 * 2_100
        served = [angle for group in method.served(ANGLES).values() for angle in group]
        assert sorted(served) == list(ANGLES)


def test_of_a_mode_a_network_sees_only_its_episodes(arena):
    of_modes, placed = arena.of_each_mode([Run(75.0, 0, 1, ()), Run(0.0, 0, 0, ())])
    datasets = of_modes.datasets
    assert len(datasets) == len(MODES) * 2
    for run_of, mode in zip(placed, ("altruistic", "egoistic"), strict=True):
        counts = datasets[run_of.dataset].counts()
        assert [name for name, (episodes, _) in counts.items() if episodes] == [mode]


def test_the_setting_with_the_greatest_mean_value_is_chosen():
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


def test_no_table_of_the_digest_differs(results, work):
    assert differs("compare-methods", results, work) == []


def test_results_are_over_seeds_and_angles(results, tmp_path):
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


def test_jobs_of_the_whole_comparison_have_names_of_their_own():
    config = Config(worlds=("crossing5", "crossing7", "intersection"))
    jobs = study.jobs(config)
    assert len(fingerprints(jobs)) == len(jobs)
    chosen = {
        (world, method.name): setting_name(method.settings[1])
        for world, method in cells_of(config, METHODS)
    }
    fresh = study.phase_jobs(config, "fresh", chosen)
    assert len(fingerprints(fresh)) == len(fresh)
    names = [job.name for job in fresh]
    assert "environments/imitation" in names and "environments/morl" in names
    peer_names = [method.name for method in METHODS.values() if method.peer]
    assert not any(name in job for job in names if "intersection" in job for name in peer_names)
    method = METHODS["clone"]
    trains, *drives = intersection.jobs_of(config, "fresh", method, 100, method.settings[:1])
    assert [job.inputs for job in drives] == [(trains.name,)] * len(config.seeds)


def test_environments_are_made_only_where_a_method_needs_them():
    def environments(**changes) -> list[str]:
        names = [job.name for job in study.jobs(Config(**changes))]
        return [name for name in names if name.startswith("environments/")]

    assert environments(worlds=("intersection",)) == []
    peers_of = environments(worlds=("crossing5",), methods=("gail", "clone"))
    assert peers_of == ["environments/imitation"]


@pytest.mark.slow
def test_the_intersection_has_values_beside_its_demonstrators(tmp_path):
    """A clone of all, which is one policy at every angle, and a method that acts."""
    config = Config(
        worlds=("intersection",),
        methods=("clone", "dial_online"),
        angles=(0.0, 90.0),
        development_angles=(45.0,),
        seeds=(10, 11),
        episodes=4,
        intersection_updates=2,
        intersection_hidden=(4,),
        intersection_batch=8,
    )
    found = run(STUDY, config, work=tmp_path / "work")
    rows = found.tables["policies"]
    assert len(rows) == 2 * 2 * 2 and {row["regret"] for row in rows} == {""}
    for seed in config.seeds:
        at = {
            row["target_angle"]: row
            for row in rows
            if (row["method"], row["seed"]) == ("clone", seed)
        }
        assert at[0.0]["value"] == at[0.0]["r_env"] and at[90.0]["value"] == at[90.0]["r_social"]
        assert at[0.0]["r_env"] == at[90.0]["r_env"]
    own = {row["target_angle"]: row for row in found.tables["demonstrators"]}
    assert own[0.0]["egoistic"] > own[0.0]["altruistic"]
    assert all(row["device"] for row in found.tables["overall"])
    (view,) = STUDY.view(found)
    means = [row["mean"] for row in view.rows]
    assert means == sorted(means, reverse=True)
    assert set(STUDY.figures(found)) == {"intersection"}


def test_settings_are_chosen_on_other_episodes_than_those_of_the_table():
    config = Config(worlds=("intersection",), methods=("clone",))
    chosen = {("intersection", "clone"): setting_name(METHODS["clone"].settings[0])}
    seeds = [
        {seed for job in jobs if isinstance(job.config, EpisodesRun) for seed in job.config.seeds}
        for jobs in (study.jobs(config), study.phase_jobs(config, "fresh", chosen))
    ]
    recorded = atlas_demonstrations(RECORDED_EPISODES).config
    demonstrated = {*range(recorded.first_seed, recorded.first_seed + 3 * recorded.episodes)}
    assert (seeds[0] - demonstrated).isdisjoint(seeds[1] - demonstrated)


SCRIPT = """
import json, sys
from pathlib import Path
import numpy as np
folder = Path(sys.argv[1])
world = np.load(folder / "world.npz")
made = {}
for number, one in enumerate(json.loads((folder / "requests.json").read_text())):
    rows = one["dataset"] * np.ones(len(world["observation"]), int)
    for place, pair in enumerate(one["weights"]):
        made[f"policy_{number}_{place}"] = np.eye(world["successor"].shape[1])[rows % 2]
np.savez(folder / "policies.npz", updates_per_second=7.0, **made)
"""


def test_files_are_exchanged_with_another_interpreter(arena, tmp_path, monkeypatch):
    """A script that takes action 0 for the first data set and 1 for the second."""
    (tmp_path / "imitation_peer.py").write_text(SCRIPT)
    monkeypatch.setattr(learners, "scripts", lambda: tmp_path)
    monkeypatch.setattr(learners, "PYTHON", Path(sys.executable))
    ground, method = Ground.of("crossing5"), METHODS["gail"]
    runs = [Run(0.0, 5, 0, method.settings[0]), Run(0.0, 6, 1, method.settings[0])]
    served = {0.0: (0.0, 15.0)}
    policies = learners.train_tabular(
        arena, ground, method, runs, served, tmp_path / "imitation", tmp_path
    )
    assert [policy[15.0].argmax(axis=1)[0] for policy in policies] == [0, 1]
    assert arena.rates[-1] == 7.0
    assert [path.name for path in tmp_path.iterdir()] == ["imitation_peer.py"]
    found = learners.request(arena, method, runs[0], (90.0,))
    assert json.loads(json.dumps(found))["weights"] == [[0.0, 1.0]]
    assert found["learning_rate"] == dict(method.settings[0])["learning_rate"]
    rows = rows_of(ground, method, {"world": "crossing5"}, 5, policies[0], (0.0, 15.0))
    assert {row["target_angle"] for row in rows} == {0.0, 15.0}


def test_a_peer_that_fails_is_told_in_one_line(arena, tmp_path, monkeypatch):
    (tmp_path / "imitation_peer.py").write_text("raise ValueError('no such thing')")
    monkeypatch.setattr(learners, "scripts", lambda: tmp_path)
    monkeypatch.setattr(learners, "PYTHON", Path(sys.executable))
    method = METHODS["gail"]
    given = (arena, Ground.of("crossing5"), method, [Run(0.0, 5, 0, method.settings[0])])
    with pytest.raises(UserError, match="no such thing") as caught:
        learners.train_tabular(*given, {0.0: (0.0,)}, tmp_path, tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wrong", [np.ones((3, 2)), -np.ones((15, 2)), np.full((15, 2), np.nan)])
def test_a_table_of_a_peer_that_is_no_policy_is_refused(wrong):
    with pytest.raises(UserError, match="must be"):
        learners.checked(wrong, Ground.of("crossing5"))


def test_the_world_of_a_peer_is_ours():
    """Its environment draws the same outcomes: probabilities, endings and rewards are the MDP's."""
    ground = Ground.of("crossing7")
    given = learners.world_arrays(ground)
    np.testing.assert_allclose(given["probability"].sum(axis=2), 1.0)
    assert given["observation"].shape == (ground.part.mdp.n_states, ground.table.world.n_features)
    assert int(given["horizon"]) == ground.table.world.horizon


@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0])
def test_the_environment_of_a_peer_gives_the_exact_totals(angle, monkeypatch):
    """In the 5x5 world nothing is left to chance."""
    monkeypatch.syspath_prepend(str(learners.scripts()))
    tabular_env = importlib.import_module("tabular_env")
    ground = Ground.of("crossing5")
    policy = expert_policy(ground.table, angle)[ground.table.mdp.reachable()]
    exact = evaluate_exactly(ground.part, policy)
    env = tabular_env.TabularEnv(learners.world_arrays(ground), vector=True)
    env.reset(seed=0)
    total, over = np.zeros(2), False
    while not over:
        _, pair, terminated, truncated, _ = env.step(policy[env.state].argmax())
        total, over = total + pair, terminated or truncated
    np.testing.assert_allclose(total, exact.totals, atol=1e-9)
    assert env.time == exact.length


def test_environments_have_pins():
    for library in {method.peer for method in METHODS.values() if method.peer}:
        job = learners.environment_job(library)
        pins = job.config.pins.splitlines()
        assert (
            all("==" in pin for pin in pins)
            and (learners.scripts() / f"{library}_peer.py").is_file()
        )


@pytest.mark.parametrize(
    ("change", "mend"),
    [
        ({"worlds": ("crossing9",)}, "choose one of"),
        ({"methods": ("gale",)}, "choose one of"),
        ({"worlds": ("crossing5", "crossing5")}, "named twice"),
        ({"seeds": (100,)}, "seed of development"),
        ({"angles": ()}, "at least one"),
        ({"intersection_hidden": (0,)}, "at least 1"),
        ({"intersection_updates": 0}, "intersection_updates"),
    ],
)
def test_wrong_configurations_are_refused(change, mend):
    with pytest.raises(UserError, match=mend):
        study.jobs(Config(**change))


def test_the_best_third_is_that_of_the_angle(arena):
    data = arena.datasets[0]
    egoistic, altruistic = (best_episodes(data, angle) for angle in (0.0, 90.0))
    for best, rest_total in ((egoistic, 0), (altruistic, 1)):
        totals = totals_of(data)[:, rest_total]
        chosen = totals_of(best)[:, rest_total]
        cut = np.sort(totals)[::-1][-(-len(totals) // 3) - 1]
        assert chosen.min() == cut and len(chosen) == (totals >= cut).sum()


def test_each_training_seed_is_judged_on_episodes_of_its_own():
    config = Config(worlds=("intersection",), methods=("clone",), seeds=(300, 301), episodes=10)
    chosen = {("intersection", "clone"): setting_name(METHODS["clone"].settings[0])}
    jobs = study.phase_jobs(config, "fresh", chosen)
    seeds = [job.config.seeds for job in jobs if isinstance(job.config, intersection.Driving)]
    assert len(seeds) == 2 and not set(seeds[0]) & set(seeds[1])
    (reference,) = [job.config for job in jobs if job.name == intersection.DEMONSTRATORS]
    assert set(reference.seeds) == {*seeds[0], *seeds[1]}


def test_a_grid_is_all_combinations():
    assert product(a=(1.0, 2.0), b=(3.0,)) == ((("a", 1.0), ("b", 3.0)), (("a", 2.0), ("b", 3.0)))

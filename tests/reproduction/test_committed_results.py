"""Recompute a small part of the committed results and compare.

Trained networks are equal bit for bit only on one kind of machine. What is compared is what every
machine must agree on: exact facts to the last printed digit, and greedy policies, which are
discrete, of runs whose decisions are not close calls.
"""

import dataclasses

import numpy as np
import pytest

from socialiq import results_folder as store
from socialiq.evaluation.dial import ceiling_regrets, support_ceiling, sweep
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.exact import Ground
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.to_json import rounded
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.intersection.driving import BATCH, Driving, Recording
from socialiq_lab.registry import find
from socialiq_lab.study import run
from socialiq_lab.tables import matching
from studies.audits import policies as audited
from studies.audits import study as audits
from studies.compare_priors import study as priors
from studies.intersection_offline import study as offline
from studies.intersection_world import study as intersection_world
from studies.theory import statements
from studies.theory import study as lines

FULL_COMPILER = True


@pytest.fixture(scope="module")
def committed():
    folder = packaged_results()
    names = ("worlds", "poc", "grid", "lambda-sweep", "theory", "compare-priors")
    names += ("intersection-world", "intersection", "audits")
    names += (
        "dial",
        "off-policy",
        "intersection-dial",
        "intersection-dial-clock",
        "intersection-offline",
    )
    return {name: store.load(folder / name) for name in names}


@pytest.mark.slow
def test_exact_facts_are_equal(committed):
    again = run(find("worlds"))
    for name in ("crossing5_readings", "crossing5_ties", "crossing7_readings", "crossing7_front"):
        for ours, theirs in zip(again.tables[name], committed["worlds"].tables[name], strict=True):
            for key, value in theirs.items():
                expected = pytest.approx(value, abs=2e-6) if isinstance(value, float) else value
                assert ours[key] == expected, (name, key)


def test_the_theory_predicts_and_finds_the_same(committed):
    """In the gridworlds; random worlds and networks are left to the study."""
    grids = statements.grid_cases(statements.gridworlds(), angles=(0.0,))
    tables = committed["theory"].tables
    again = {"slopes": lines.slope_rows(grids), "flips": lines.flip_rows(grids, "online")}
    compared = 0
    for name, keys in (("slopes", ()), ("flips", ("next_value", "state"))):
        labels = ("world", "angle", "target_kind", *keys)
        theirs = {tuple(row[key] for key in labels): row for row in tables[name]}
        for row in again[name]:
            wanted = theirs[tuple(row[key] for key in labels)]
            for column in ("predicted", "measured", "found"):
                if column in row and row[column] != "":
                    assert wanted[column] == pytest.approx(row[column], rel=2e-3, abs=2e-6)
                    compared += 1
    assert compared >= 4 + 4 + 2 * 11  # every slope twice, every flip twice


@pytest.mark.slow
def test_the_seven_by_seven_baseline_and_extremes_are_equal(committed):
    config = find("grid").Config(
        seeds=(10, 11), target_kinds=("running",), strengths=(1.0,), comparisons=False
    )
    again = run(find("grid"), config)
    wanted = {
        (row["method"], row["target_angle"], row["seed"]): row
        for row in committed["grid"].tables["policies"]
        if row["mixture"] == "equal_trajectories"
        and row["readout"] == "greedy"
        and (row["target_kind"], row["strength"]) in (("none", 0.0), ("running", 1.0))
        and row["method"] != "behaviour_cloning"
    }
    compared = 0
    for row in again.tables["policies"]:
        if row["readout"] != "greedy" or row["target_angle"] == 45.0:
            continue
        theirs = wanted[row["method"], row["target_angle"], row["seed"]]
        assert row["angle"] == pytest.approx(theirs["angle"], abs=1e-5)
        assert row["arrival"] == pytest.approx(theirs["arrival"], abs=1e-5)
        compared += 1
    assert compared == 8  # two seeds; baseline and targets, each at 0 and 90 degrees


@pytest.mark.slow
def test_the_five_by_five_egoist_and_altruist_are_equal(committed):
    again = run(find("poc"), find("poc").Config(seeds=(20, 21), readings=False))

    def sequences(results):
        return {
            (row["policy"], row["seed"]): row["sequence"]
            for row in results.tables["sequences"]
            if row["policy"] in ("egoistic", "altruistic")
            and (row["target_kind"], row["next_value"]) == ("running", "online")
        }

    found, theirs = sequences(again), sequences(committed["poc"])
    assert len(found) == 4
    assert found == {key: theirs[key] for key in found}


@pytest.mark.slow
def test_off_policy_estimates_are_equal(committed):
    again = run(find("off-policy"), find("off-policy").Config(seeds=(540,), explored=(0.0, 0.1)))
    stored = committed["off-policy"].tables["estimates"]
    wanted = [row for row in stored if row["seed"] == 540 and row["explored"] in (0.0, 0.1)]
    assert len(again.tables["estimates"]) == len(wanted) == 2 * 2 * 7 * 3
    for row, old in zip(again.tables["estimates"], wanted, strict=True):
        numbers = [name for name, value in old.items() if isinstance(value, float)]
        assert [row[n] for n in numbers] == pytest.approx([old[n] for n in numbers], abs=2e-6)


@pytest.mark.slow
def test_the_ends_of_the_sweep_are_equal(committed):
    config = find("lambda-sweep").Config(
        seeds=(10,), strengths=(0.0, 5.0), target_kinds=("instantaneous",), checkpoint_every=3000
    )
    again = run(find("lambda-sweep"), config)
    theirs = {
        (row["target_kind"], row["strength"]): row
        for row in committed["lambda-sweep"].tables["final"]
        if row["seed"] == 10 and row["readout"] == "greedy"
    }
    compared = 0
    for row in again.tables["final"]:
        if row["readout"] == "greedy":
            key = (row["target_kind"], row["strength"])
            assert row["angle"] == pytest.approx(theirs[key]["angle"], abs=1e-5)
            compared += 1
    assert compared == 3  # the baseline, and both ends


def test_the_clones_of_the_comparison_are_equal(committed, tmp_path):
    """One of its methods, which all share seeds, data and budget, on one of its seeds."""
    theirs = committed["compare-priors"]
    config = find("compare-priors").Config(angles=(0.0, 45.0, 90.0))
    config = dataclasses.replace(config, methods=("clone_of_mode",), seeds=config.seeds[:1])
    (job,) = (job for job in priors.more_jobs(config, tmp_path) if "crossing7" in job.name)
    job.work(job.config, tmp_path, {}, lambda _: None)
    wanted = {
        (row["method"], row["target_angle"], row["readout"], row["seed"]): row
        for row in theirs.tables["policies"]
        if row["world"] == "crossing7"
    }
    ours = [row for row in store.from_csv(tmp_path / priors.ROWS) if row["readout"] == "greedy"]
    assert len(ours) == 3
    for row in ours:
        their = wanted["clone_of_mode", row["target_angle"], "greedy", row["seed"]]
        assert row["regret"] == pytest.approx(their["regret"], abs=1e-5)
        assert row["effective_share"] == pytest.approx(their["effective_share"], abs=1e-5)


def test_the_bellman_shift_of_the_comparison_is_the_baseline(committed):
    rows = committed["compare-priors"].tables["policies"]
    kept = ("world", "target_angle", "readout", "seed", "r_env", "r_social", "regret")
    none, shift = (
        [[row[name] for name in kept] for row in rows if row["method"] == method]
        for method in ("none", "bellman_shift")
    )
    assert none == shift and none


@pytest.mark.parametrize("driver", ["go", "gap_3s"])
def test_the_intersection_pays_and_ends_as_before(committed, driver):
    results = committed["intersection-world"]
    seed, episodes = results.config["seeds"][0], results.config["reading_episodes"]
    again = intersection_world.drive({}, driver, range(seed, seed + episodes))
    theirs = results.summary["default_reading"][driver]
    found = intersection_world.reward_row(again)
    for name in ("collision", "arrival", "timeout"):
        # A processor may round an episode or two out of five thousand to another end.
        assert found[name] == pytest.approx(theirs[name], abs=4.1e-4)
    for name in ("r_env", "r_social", "classical_own", "yielding_active"):
        assert found[name] == pytest.approx(theirs[name], abs=0.01)


def test_the_intersection_begins_as_before(committed):
    results = committed["intersection-world"]
    again = intersection_world.start_row(1_000_000, 5_000)
    assert rounded(again) == results.summary["start"]


@pytest.fixture(scope="module")
def batch():
    return Intersection().batch(BATCH)


@pytest.mark.parametrize("name", ["expert_prosocial", "prosocial"])
def test_the_atlas_drives_as_before(committed, batch, name):
    first, episodes = Driving().first_seed, committed["intersection"].config["episodes"]
    again = episodes_of(batch, atlas.load(name), np.arange(first, first + episodes))
    found, theirs = intersection_world.outcome_row(again), atlas.manifest()[name]["greedy"]
    assert episodes == theirs["episodes"] == found["episodes"]
    for outcome in ("collision", "arrival", "timeout"):
        # A processor may round a network's close call, and so a few episodes, to another action.
        assert found[outcome] == pytest.approx(theirs[outcome], abs=5 / episodes)
    rewards = intersection_world.reward_row(again)
    for signal in ("r_env", "r_social"):
        assert rewards[signal] == pytest.approx(theirs[signal], abs=0.02)


def test_the_demonstrations_of_the_altruist_pay_as_before(committed, batch):
    first = Recording().first_seed + 2 * committed["intersection"].config["pool_episodes"]
    seeds = np.arange(first, first + committed["intersection"].config["pool_episodes"])
    again = intersection_world.reward_row(
        episodes_of(batch, atlas.load("expert_altruistic"), seeds)
    )
    theirs = committed["intersection"].summary["table_a_1"]["altruistic"]
    pairs = {"g_self": "classical_own", "g_global": "classical_others"}
    pairs |= {"g_env": "r_env", "g_social": "r_social"}
    for signal, ours in pairs.items():
        assert again[ours] == pytest.approx(theirs[signal]["mean"], abs=0.02)
        assert again[f"{ours}_sd"] == pytest.approx(theirs[signal]["sd"], abs=0.02)


@pytest.mark.parametrize(
    ("folder", "family", "angle"),
    [
        ("intersection-dial", "dial", 0.0),
        ("intersection-dial", "dial", 60.0),
        ("intersection-dial-clock", "timed", 45.0),
        ("intersection-dial-clock", "calibrated", 90.0),
        ("intersection-dial-clock", "iterated", 30.0),
    ],
)
def test_the_dial_drives_as_before(committed, batch, folder, family, angle):
    """The dial of the first seed, stored beside the tables."""
    results = committed[folder]
    seed, episodes = results.config["seeds"][0], results.config["episodes"]
    (theirs,) = [
        row
        for row in results.tables["policies"]
        if (row["family"], row["seed"], row["asked"]) == (family, seed, angle)
    ]
    turned = DialPolicy.load(packaged_results() / folder / f"{family}.safetensors")
    seeds = np.arange(20_000_000, 20_000_000 + episodes)
    again = episodes_of(batch, turned.at(angle), seeds)
    found = intersection_world.outcome_row(again) | intersection_world.reward_row(again)
    for name in ("collision", "arrival", "timeout", "ego_struck", "ego_was_struck"):
        # As above, a few episodes.
        assert found[name] == pytest.approx(theirs[name], abs=5 / episodes), name
    for name in ("r_env", "r_social"):
        assert found[name] == pytest.approx(theirs[name], abs=0.02), name


@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_the_offline_dial_drives_as_before(committed, batch, angle):
    """The dial of the first seed, stored beside the tables."""
    results = committed["intersection-offline"]
    config = results.config
    (theirs,) = [
        row
        for row in results.tables["policies"]
        if (row["method"], row["seed"], row["asked"]) == (offline.OWN, config["seeds"][0], angle)
    ]
    turned = DialPolicy.load(packaged_results() / "intersection-offline" / "dial.safetensors")
    seeds = np.arange(config["first_episode"], config["first_episode"] + config["episodes"])
    again = episodes_of(batch, turned.at(angle), seeds).metrics()
    assert again.value(angle) == pytest.approx(theirs["value"], abs=0.02)
    for name in ("collision", "arrival", "timeout"):
        assert getattr(again, name) == pytest.approx(theirs[name], abs=5 / len(seeds)), name


def test_the_offline_tests_follow_from_the_values(committed):
    """Every difference and verdict, from the values of the policies."""
    results = committed["intersection-offline"]
    names = ("seeds", "angles", "methods", "method_angles")
    settings = {name: tuple(results.config[name]) for name in names}
    config = find("intersection-offline").Config(**settings)
    again = offline.compared(config, results.tables["policies"])
    for name in ("differences", "forms"):
        for ours, theirs in zip(again[name], results.tables[name], strict=True):
            for key, value in theirs.items():
                expected = pytest.approx(value, abs=2e-5) if isinstance(value, float) else value
                assert ours[key] == expected, (name, key)
    assert offline.summarised(again) == results.summary


@pytest.mark.slow
def test_audits_come_out_as_before(committed, tmp_path):
    """Of files whose bytes are the same everywhere, so that their episodes are too."""
    theirs = {(row["policy"], row["declared"]): row for row in committed["audits"].tables["audits"]}
    audited.exact_in_gridworld(tmp_path)
    found = [one for one in audited.of_gridworld(tmp_path, ()) if "exact" in one.name][:2]
    found += [one for one in audited.at_intersection(tmp_path) if one.name == "never moves"]
    names = ("verdict", "decided_by", "regret_decision", "best", "explained", "policy_sha256")
    for ours in audits.audit_rows(found, 1000, 2026, tmp_path):
        their = theirs[ours["policy"], ours["declared"]]
        assert {name: ours[name] for name in names} == {name: their[name] for name in names}
        for name in ("regret", "regret_low", "regret_high"):
            assert ours[name] == pytest.approx(their[name], abs=0.02)
    assert len(found) == 3


def test_what_was_printed_gives_the_same(committed):
    tables = committed["audits"].tables
    rows = audits.published_tables(committed["audits"].config["published_episodes"])
    for name, again in rows.items():
        assert rounded(again) == tables[name], name


@pytest.mark.parametrize("support", ["timed", "any time"])
def test_the_ceiling_of_the_demonstrations_is_the_same(committed, support):
    """The dials themselves take minutes and are left to the study."""
    theirs = [
        (row["angle"], row["regret"])
        for row in committed["dial"].tables["ceilings"]
        if (row["support"], row["seed"]) == (support, 30)
    ]
    angles = [angle for angle, _ in theirs]
    ground = Ground.of("crossing7").with_clock(True)
    (data,) = trajectory_datasets(ground.table, [30], committed["dial"].config["episodes_each"])
    ceiling = support_ceiling(data, ground.part, timed=support == "timed")
    again = ceiling_regrets(ceiling, ground.optimum, angles)
    assert len(angles) == 19
    assert list(again) == pytest.approx([regret for _, regret in theirs], abs=2e-6)


def test_the_dial_of_the_gridworld_is_worth_what_its_results_say():
    """The short run's dial of the first seed, evaluated exactly again."""
    folder = packaged_results() / "dial-short"
    results = store.load(folder)
    assert (results.config["runs"], len(results.config["seeds"])) == (["online-short"], 20)
    theirs = matching(results.tables["angles"], seed=220, readout="greedy")
    angles = [row["angle"] for row in theirs]
    swept = sweep(
        DialPolicy.load(folder / "dial.safetensors"),
        Ground.of("crossing7").with_clock(clock=True).part,
        "greedy",
        angles,
    )
    assert len(angles) == 19
    for metrics, their in zip(swept.metrics, theirs, strict=True):
        assert metrics.r_env == pytest.approx(their["r_env"], abs=2e-6)
        assert metrics.r_social == pytest.approx(their["r_social"], abs=2e-6)

"""The study of the hidden skill: its reward by hand, its pieces, and end to end at a tiny size."""

import dataclasses
import shutil

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import softmax
from studies.intersection_skill.jobs import likelihood
from studies.intersection_skill.plan import (
    ALONE,
    CLONES,
    EXPERTS,
    IMPROVED,
    INFERRED,
    LATER,
    METHODS,
    PRIOR,
    REFERENCES,
    SHARED,
    TURNED,
    UNSKILLED,
    Config,
)
from studies.intersection_skill.skill import (
    ScoredEpisodes,
    drive,
    nearest,
    skill,
    with_skill,
)
from studies.intersection_skill.study import STUDY, interval, score_row

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.evaluation.play import play
from socialiq.learners.expert_table import Batch as Rows
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.plotting.style import png
from socialiq.social.angle import exact_weights
from socialiq.types import Ending, RewardPair
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import policy
from socialiq_lab import results as store
from socialiq_lab.study import run

CONFIG = Config()
TINY = dataclasses.replace(
    CONFIG,
    seeds=(0, 1),
    angles=(0.0, 30.0, 90.0),
    expert_structure=dataclasses.replace(CONFIG.expert_structure, hidden=(8,), steps=2400),
    pool_episodes=12,
    size=60,
    structure=dataclasses.replace(
        CONFIG.structure,
        view="flat",
        hidden=(8,),
        skill_hidden=(8,),
        updates=30,
        expert_batch=9,
        replay_batch=7,
        replay_capacity=5000,
    ),
    returns_structure=dataclasses.replace(
        CONFIG.returns_structure, view="flat", hidden=(8,), batch_size=8, updates=20
    ),
    clone_structure=dataclasses.replace(
        CONFIG.clone_structure, view="flat", hidden=(8,), batch_size=8, updates=20
    ),
    turned_structure=dataclasses.replace(
        CONFIG.turned_structure, view="flat", hidden=(8,), batch_size=8, updates=20
    ),
    improved_structure=dataclasses.replace(
        CONFIG.improved_structure,
        view="flat",
        hidden=(8,),
        batch_size=8,
        updates=20,
        states_per_update=1,
        first_rounds=1,
        replay_capacity=500,
    ),
    prices=(0.1, 3.0),
    left_out_updates=10,
    grid=45,
    episodes=12,
)


def seen(x: float, y: float, speed: float) -> np.ndarray:
    """An observation of the ego alone, driving north."""
    rows = np.zeros((10, 7), np.float32)
    rows[0] = [1.0, x / 100.0, y / 100.0, 0.0, -speed / 20.0, 0.0, -1.0]
    return rows.ravel()


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ((2.0, 40.0, 9.0), (2.0, 31.0, 9.0), 0.0),  # drives on
        ((2.0, 40.0, 9.0), (2.0, 33.0, 4.5), -1.0),  # a level slower
        ((2.0, 40.0, 0.0), (2.0, 35.0, 9.0), -2.0),  # two levels faster
        ((2.0, 14.0, 0.0), (2.0, 14.0, 0.0), 0.0),  # stands before its stop line
        ((2.0, 9.0, 0.0), (2.0, 9.0, 0.0), -1.0),  # stands in the junction
        ((2.0, 12.0, 4.5), (2.0, 10.0, 0.0), -2.0),  # and stopped there
        ((2.0, 9.0, 1.5), (2.0, 8.0, 1.5), 0.0),  # rolls through it
        ((-15.0, 2.0, 0.0), (-15.0, 2.0, 0.0), 0.0),  # stands on the exit
    ],
)
def test_the_skill_counts_levels_of_speed_and_standing_in_the_junction(before, after, expected):
    found = skill(seen(*before)[None], seen(*after)[None])
    assert found == pytest.approx([expected], abs=1e-6)


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0])
def test_a_demonstrators_score_is_the_reward_and_the_skill(angle) -> None:
    observation = jnp.stack([seen(2.0, 40.0, 9.0), seen(2.0, 9.0, 0.0)])
    following = jnp.stack([seen(2.0, 33.0, 4.5), seen(2.0, 9.0, 0.0)])
    pair = RewardPair(jnp.array([1.0, 2.0]), jnp.array([0.5, -1.0]))
    rows = Rows(observation, jnp.array([0, 0]), following, jnp.array([0, 0]), pair)

    found = with_skill(lambda _act, _rng: rows, 0.5, angle)(lambda o: o, np.random.default_rng(0))
    direction = exact_weights(angle)
    plain = direction.env * np.array([1.0, 2.0]) + direction.social * np.array([0.5, -1.0])
    scored = direction.env * found.target.env + direction.social * found.target.social
    np.testing.assert_allclose(scored, plain - 0.5, atol=1e-6)
    assert found.observation is rows.observation


def test_what_is_driven_is_what_the_core_tells() -> None:
    seeds = np.arange(4)
    driven = drive(Batch(Options(), 4), policy("gap_3s"), seeds)
    rewards, changes = np.zeros(4), np.zeros(4)
    for played in play(Batch(Options(), 4), policy("gap_3s"), seeds):
        rows = np.flatnonzero(played.running)
        before = np.hypot(*played.observation[rows][:, 3:5].T) * 20.0
        np.add.at(changes, played.episode[rows], np.abs(played.made.speed[rows] - before) / 4.5)
        np.add.at(rewards, played.episode[rows], played.made.rewards.env[rows])
    np.testing.assert_allclose(driven.env, rewards, atol=1e-9)
    np.testing.assert_allclose(driven.changes, changes, atol=1e-4)


def test_rows_are_means_over_episodes() -> None:
    driven = ScoredEpisodes(
        env=np.array([4.0, 0.0]),
        social=np.array([0.0, 2.0]),
        changes=np.array([1.0, 3.0]),
        standing=np.array([0.0, 2.0]),
        ending=np.array([int(Ending.ARRIVAL), int(Ending.COLLISION)]),
        length=np.array([9, 11]),
    )
    row = score_row(driven, 90.0, dataclasses.replace(CONFIG, weight=0.5))
    assert row["told"] == pytest.approx(1.0) and row["skill"] == -3.0
    assert row["score"] == pytest.approx(1.0 - 0.5 * 3.0)  # of -0.5 and -0.5
    assert row["score_low"] == row["score_high"] == pytest.approx(-0.5)
    assert (row["arrival"], row["collision"], row["timeout"]) == (0.5, 0.5, 0.0)


def test_the_interval_is_of_the_mean() -> None:
    values = np.random.default_rng(0).normal(3.0, 2.0, 400)
    low, high = interval(values)
    half = 1.96 * values.std() / 20.0
    assert low == pytest.approx(values.mean() - half, abs=0.03)
    assert high == pytest.approx(values.mean() + half, abs=0.03)


def test_the_nearest_policy_drives_at_an_angle_that_has_none() -> None:
    shown = (90.0, 0.0, 45.0)
    assert [nearest(a, shown) for a in (0.0, 15.0, 22.5, 30.0, 75.0)] == [0.0, 0.0, 0.0, 45.0, 90.0]


def test_an_angle_is_inferred_from_actions_that_it_drew() -> None:
    network = DialNetwork.initialise(jax.random.key(0), 7, (), 3)
    weight = jnp.zeros((3, 9)).at[1, 7].set(1.0).at[2, 8].set(1.0)  # Q = (0, cos α, sin α)
    network = eqx.tree_at(lambda n: (n.layers[0].weight,), network, (weight,))
    network = eqx.tree_at(lambda n: (n.layers[0].bias,), network, (jnp.zeros(3),))
    family = DialPolicy.of(network, 0.02, 0.0, 90.0, {})
    rng = np.random.default_rng(0)
    observation = rng.normal(size=(4000, 7)).astype(np.float32)
    chances = softmax(np.array([0.0, 0.5, 3**0.5 / 2]) / 0.3)  # 60 degrees, at one τ that is tried
    action = rng.choice(3, size=4000, p=chances)
    angles = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0]
    found = likelihood(family, observation, action, angles)
    assert angles[int(found.argmax())] == 60.0


def test_all_dials_see_as_many_rows_and_differ_in_what_they_are_with_skill() -> None:
    alone, prior, shared = (CONFIG.dial_of(method) for method in (ALONE, PRIOR, SHARED))
    assert not alone.demonstrations and alone.replay_batch == shared.expert_batch + (
        shared.replay_batch
    )
    assert prior.demonstrations and not prior.demonstrators
    assert shared.demonstrators == (0.0, 45.0, 90.0)
    assert CONFIG.numbers_of(PRIOR, 3).prior_weight == CONFIG.prior_weight
    assert CONFIG.numbers_of(SHARED, 3) == dataclasses.replace(CONFIG.numbers, seed=3)


@pytest.fixture(name="work", scope="module")
def work_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study") / "work"


@pytest.fixture(name="results", scope="module")
def tiny_results(work):
    return run(STUDY, TINY, work=work)


def test_every_method_is_scored_at_every_angle(results) -> None:
    rows = results.tables["scores"]
    assert len(rows) == (len(METHODS) + 1) * 2 * 3 + 2 * 3
    assert {row["method"] for row in rows} == {*METHODS, *REFERENCES}
    for row in rows:
        direction = exact_weights(row["angle"])
        value = direction.env * row["r_env"] + direction.social * row["r_social"]
        assert row["told"] == pytest.approx(value, abs=1e-5)
        assert row["skill"] == pytest.approx(-row["changes"] - row["standing"], abs=1e-5)
        assert row["score"] == pytest.approx(value + TINY.weight * row["skill"], abs=1e-5)
        assert row["demonstrated"] == int(row["angle"] in (0.0, 90.0))


def test_methods_are_compared_with_learning_alone_in_pairs(results) -> None:
    groups = {(r["method"], r["seed"], r["angles"]): r["score"] for r in results.tables["groups"]}
    rows = {(row["method"], row["angles"]): row for row in results.tables["differences"]}
    assert set(rows) == {
        (method, group)
        for method in (*METHODS[1:], CLONES)
        for group in ("all", "demonstrated", "unseen")
    }
    gaps = [groups[SHARED, seed, "unseen"] - groups[ALONE, seed, "unseen"] for seed in (0, 1)]
    assert rows[SHARED, "unseen"]["mean"] == pytest.approx(np.mean(gaps), abs=1e-5)
    assert results.summary["methods"][EXPERTS]["all"]["score"] == pytest.approx(
        groups[EXPERTS, "", "all"], abs=1e-5
    )


def test_inferred_angles_are_those_that_the_dial_was_with_skill(results, work) -> None:
    rows = results.tables["angles"]
    assert {row["step"] for row in rows} == {0, 1}
    assert {row["angle"] for row in rows} <= {0.0, 45.0, 90.0}
    first = tuple(row["angle"] for row in rows if (row["step"], row["seed"]) == (0, 1))
    dial = DialPolicy.load(work / "inferred" / "1" / "dial.safetensors")
    assert tuple(dial.provenance["structure"]["demonstrators"]) == first


@pytest.fixture(name="later", scope="module")
def later_results(work, results):
    """The later methods, beside the same demonstrators."""
    assert results
    return run(STUDY, dataclasses.replace(TINY, methods=LATER), work=work)


def test_the_price_is_that_which_predicts_the_ones_left_out_best(later) -> None:
    rows = later.tables["choices"]
    assert {row["left_out"] for row in rows} == {"egoistic", "prosocial", "altruistic"}
    means = {
        price: np.mean([row["agreement"] for row in rows if row["price"] == price])
        for price in TINY.prices
    }
    assert {row["price"] for row in rows if row["chosen"]} == {max(means, key=lambda p: means[p])}


def test_later_methods_are_compared_with_the_demonstrators(later, results) -> None:
    groups = {(r["method"], r["seed"], r["angles"]): r["score"] for r in later.tables["groups"]}
    rows = {(row["method"], row["angles"]): row for row in later.tables["above"]}
    assert set(rows) == {(m, g) for m in LATER for g in ("all", "demonstrated", "unseen")}
    gaps = [groups[IMPROVED, seed, "all"] - groups[EXPERTS, "", "all"] for seed in (0, 1)]
    assert rows[IMPROVED, "all"]["mean"] == pytest.approx(np.mean(gaps), abs=1e-5)
    for name in (EXPERTS, UNSKILLED):
        theirs = [row for row in results.tables["scores"] if row["method"] == name]
        assert [row for row in later.tables["scores"] if row["method"] == name] == theirs
    assert "differences" not in later.tables


def test_the_improved_dial_begins_with_the_clone_of_its_seed(later, work) -> None:
    assert {row["method"] for row in later.tables["scores"]} == {*LATER, EXPERTS, UNSKILLED}
    clone = DialPolicy.load(work / "turned" / "1" / "dial.safetensors")
    made = DialPolicy.load(work / "improved" / "1" / "dial.safetensors")
    assert made.provenance["start"]["sha256"] == clone.turned.sha256
    assert clone.provenance["learner"] == "clone_dial" and TURNED in later.summary["methods"]


def test_references_drive_alike_with_every_training_seed(results) -> None:
    rows = [row for row in results.tables["scores"] if row["method"] == UNSKILLED]
    assert [(row["seed"], row["angle"]) for row in rows] == [("", a) for a in TINY.angles]


def test_a_study_that_was_cut_off_goes_on_and_ends_alike(results, work) -> None:
    before = {path: path.stat().st_mtime_ns for path in work.rglob("job.json")}
    (work / "shared" / "1").rename(work / "shared" / "1.part")  # cut off before its end
    (work / "shared" / "1.part" / "job.json").unlink()
    shutil.rmtree(work / "evaluation" / "shared" / "1")
    again = run(STUDY, TINY, work=work)
    after = {path: path.stat().st_mtime_ns for path in work.rglob("job.json")}
    changed = {str(path.parent.relative_to(work)) for path in after if after[path] != before[path]}
    assert changed == {"shared/1", "evaluation/shared/1"}
    assert again.tables["scores"] == results.tables["scores"]


def test_results_are_saved_shown_and_drawn_from_the_files(results, tmp_path, capsys) -> None:
    folder = tmp_path / STUDY.name
    store.save(results, folder, {}, replace=False)
    assert main(["reproduce", STUDY.name, "--from", str(tmp_path), "--json"]) == 0
    assert '"shared competence"' in capsys.readouterr().out
    assert main(["reproduce", STUDY.name, "--from", str(folder)]) == 0
    drawn = png(STUDY.figures(store.load(folder)))
    assert list(drawn) == ["scores", "parts", "learning"]


def test_nonsense_is_refused() -> None:
    with pytest.raises(UserError, match="choose one of"):
        Config(methods=("magic",))
    with pytest.raises(UserError, match="compare with"):
        Config(methods=(INFERRED,))
    with pytest.raises(UserError, match="price"):
        Config(prices=(0.0,))
    with pytest.raises(UserError, match="range"):
        Config(angles=(120.0,))
    with pytest.raises(UserError, match="episodes"):
        Config(episodes=0)

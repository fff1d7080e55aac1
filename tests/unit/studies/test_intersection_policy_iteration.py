"""The study of policy iteration end to end at a tiny size: jobs, tables, atlas, figures."""

import json

import pytest
from studies import intersection_policy_iteration as iteration

from socialiq.errors import UserError
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.plotting.style import png
from socialiq_lab import results as store
from socialiq_lab.intersection.episodes import LAST
from socialiq_lab.study import run

TINY = iteration.Config(seeds=(0, 1), modes=("egoistic",), updates=200, episodes=12)


@pytest.fixture(name="work", scope="module")
def work_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study") / "work"


@pytest.fixture(name="results", scope="module")
def tiny_results(work):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(iteration, "STATES", 4)
        return run(iteration.STUDY, TINY, work=work)


def test_networks_and_ensemble_drive_beside_the_atlas(results):
    names = {row["policy"] for row in results.tables["policies"]}
    alone = {"networks/egoistic/0", "networks/egoistic/1", "ensembles/egoistic"}
    ahead = {"foresight/networks/egoistic/0", "foresight/ensembles/egoistic"}
    assert names == alone | ahead | {"atlas/egoistic"}
    assert {row["episodes"] for row in results.tables["policies"]} == {TINY.episodes}


def test_the_ensemble_is_of_all_seeds_and_in_the_atlas(results, work):
    made = EnsemblePolicy.load(work / "ensembles" / "egoistic" / LAST)
    assert [one.provenance["numbers"]["seed"] for one in made.members] == [0, 1]
    assert made.provenance["learner"] == "policy-iteration"
    entry = json.loads(results.files["atlas/manifest.json"])["policies"]["iterated_egoistic"]
    assert entry["sha256"] == made.sha256


def test_the_summary_has_the_spread_over_seeds(results):
    rows = {row["policy"]: row for row in results.tables["policies"]}
    found = results.summary["egoistic"]
    arrivals = [rows[f"networks/egoistic/{seed}"]["arrival"] for seed in TINY.seeds]
    assert found["networks"]["arrival"]["mean"] == pytest.approx(sum(arrivals) / 2, abs=1e-5)
    assert found["seeds_that_reach_it"] == sum(
        iteration.reaches("egoistic", rows[f"networks/egoistic/{seed}"]) for seed in TINY.seeds
    )


def test_results_are_saved_and_drawn_from_the_files(results, tmp_path):
    store.save(results, tmp_path / "out", {}, replace=False)
    drawn = png(iteration.STUDY.figures(store.load(tmp_path / "out")))
    assert list(drawn) == ["egoistic"]


def test_a_careful_network_with_a_clock_begins_with_the_same_expert():
    config = iteration.Config(seeds=(0,), clock=True, collision_weight=-8.0)
    made = iteration.run_of(config, "prosocial", 0)
    assert (made.structure.times, made.labels.collision_weight) == (20, -8.0)
    assert (made.options.collision_weight, made.start) == (-2.0, "set_prosocial")


def test_an_aim_holds_for_each_of_its_columns():
    row = {"arrival": 0.96, "collision": 0.009, "ego_struck": 0.002}
    assert iteration.reaches("prosocial", row)
    assert not iteration.reaches("prosocial", row | {"ego_struck": 0.004})
    assert not iteration.reaches("egoistic", row)


@pytest.mark.parametrize("changed", [{"seeds": ()}, {"episodes": 0}, {"modes": ("altruistic",)}])
def test_a_wrong_configuration_is_refused(changed):
    with pytest.raises(UserError, match="at least"):
        iteration.Config(**changed)

"""The study of the experts' networks end to end at a tiny size: jobs, tables, atlas, figures."""

import json

import pytest
from studies import intersection_networks as networks

from socialiq.errors import UserError
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting.style import png
from socialiq_lab import results as store
from socialiq_lab.intersection.experts import expert_name, policy_file
from socialiq_lab.study import run

TINY = networks.Config(
    seeds=(0, 1), flat_steps=9600, set_steps=2400, episodes=12, highway_episodes=0
)


@pytest.fixture(name="work", scope="module")
def work_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("study") / "work"


@pytest.fixture(name="results", scope="module")
def tiny_results(work):
    return run(networks.STUDY, TINY, work=work)


def test_every_expert_drives_with_and_without_foresight(results):
    names = {row["policy"] for row in results.tables["policies"]}
    experts = {expert_name(n, "egoistic", s) for n in networks.NETWORKS for s in TINY.seeds}
    experts |= {expert_name("set", mode, 0) for mode in ("prosocial", "altruistic")}
    assert names == experts | {name.replace("experts/", "foresight/") for name in experts}
    assert {row["episodes"] for row in results.tables["policies"]} == {TINY.episodes}


def test_the_summary_is_of_the_egoists_of_each_network(results):
    rows = {row["policy"]: row for row in results.tables["policies"]}
    for network, group in results.summary["egoists"].items():
        mine = [rows[expert_name(network, "egoistic", seed)] for seed in TINY.seeds]
        assert group["arrival"]["mean"] == pytest.approx(
            sum(row["arrival"] for row in mine) / 2, abs=1e-5
        )
        assert group["collision"]["high"] == max(row["collision"] for row in mine)
        reaching = [row for row in mine if row["arrival"] >= 0.95 and row["collision"] <= 0.04]
        assert group["reach_target"] == len(reaching)


def test_networks_are_compared_in_pairs(results):
    rows = {row["policy"]: row for row in results.tables["policies"]}
    found = {row["metric"]: row for row in results.tables["differences"]}
    gaps = [
        rows[expert_name("set", "egoistic", seed)]["r_env"]
        - rows[expert_name("flat", "egoistic", seed)]["r_env"]
        for seed in TINY.seeds
    ]
    assert found["r_env"]["mean"] == pytest.approx(sum(gaps) / 2, abs=1e-4)


def test_the_trio_that_sees_a_set_is_the_atlas(results, work):
    manifest = json.loads(results.files["atlas/manifest.json"])["policies"]
    assert set(manifest) == {"set_egoistic", "set_prosocial", "set_altruistic"}
    for name, entry in manifest.items():
        source = work / entry["job"] / policy_file(entry["job"])
        assert results.files[f"atlas/{name}.safetensors"] == source.read_bytes()
        assert QPolicy.load(source).sha256 == entry["sha256"]
        assert entry["made_by"] == "socialiq reproduce intersection-networks"


def test_results_are_saved_and_drawn_from_the_files(results, tmp_path):
    store.save(results, tmp_path / "out", {}, replace=False)
    drawn = png(networks.STUDY.figures(store.load(tmp_path / "out")))
    assert list(drawn) == ["egoists", "learning"]
    assert all(picture.startswith(b"\x89PNG") for picture in drawn.values())


@pytest.mark.parametrize("changed", [{"seeds": ()}, {"episodes": 0}, {"highway_episodes": -1}])
def test_a_wrong_configuration_is_refused(changed):
    with pytest.raises(UserError, match="at least"):
        networks.Config(**changed)

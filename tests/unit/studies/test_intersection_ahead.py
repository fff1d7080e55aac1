"""The study of online planning end to end at a tiny size: jobs, tables, figures."""

import pytest
from studies import intersection_ahead as ahead

from socialiq.errors import UserError
from socialiq.plotting.style import png
from socialiq_lab import results as store
from socialiq_lab.study import run

TINY = ahead.Config(seeds=(0, 1), set_steps=2400, draws=2, decisions=1, episodes=12)


@pytest.fixture(name="results", scope="module")
def tiny_results(tmp_path_factory):
    return run(ahead.STUDY, TINY, work=tmp_path_factory.mktemp("study") / "work")


def test_every_egoist_drives_alone_ahead_and_with_foresight(results):
    names = {row["policy"] for row in results.tables["policies"]}
    for seed in TINY.seeds:
        assert {
            f"{stage}/set/egoistic/{seed}" for stage in ("experts", "ahead", "foresight")
        } < names
    assert {row["episodes"] for row in results.tables["policies"]} == {TINY.episodes}


def test_the_atlas_drives_where_it_believes_to_be_and_elsewhere(results):
    found = results.summary["atlas"]
    expected = {
        f"egoistic/{where}/{kind}" for where in ahead.TRAFFIC for kind in ("plain", "ahead")
    }
    expected |= {
        f"{m}/as_believed/{k}" for m in ("prosocial", "altruistic") for k in ("plain", "ahead")
    }
    assert set(found) == expected
    plain = {where: found[f"egoistic/{where}/plain"]["r_env"] for where in ahead.TRAFFIC}
    assert len(set(plain.values())) == len(plain)  # other traffic, other returns


def test_the_summary_counts_who_reaches_the_target(results):
    rows = {row["policy"]: row for row in results.tables["policies"]}
    for kind, stage in (("plain", "experts"), ("ahead", "ahead")):
        mine = [rows[f"{stage}/set/egoistic/{seed}"] for seed in TINY.seeds]
        group = results.summary["egoists"][kind]
        assert group["arrival"]["high"] == max(row["arrival"] for row in mine)
        reached = [r for r in mine if r["arrival"] >= 0.95 and r["collision"] <= 0.04]
        assert group["reach_target"] == len(reached)


def test_differences_are_paired(results):
    rows = {row["policy"]: row for row in results.tables["policies"]}
    gaps = [
        rows[f"ahead/set/egoistic/{seed}"]["r_env"] - rows[f"experts/set/egoistic/{seed}"]["r_env"]
        for seed in TINY.seeds
    ]
    found = {row["metric"]: row for row in results.tables["differences"]}
    assert found["r_env"]["mean"] == pytest.approx(sum(gaps) / 2, abs=1e-4)


def test_results_are_saved_and_drawn_from_the_files(results, tmp_path):
    store.save(results, tmp_path / "out", {}, replace=False)
    drawn = png(ahead.STUDY.figures(store.load(tmp_path / "out")))
    assert set(drawn) == {"egoists", "elsewhere"}


@pytest.mark.parametrize("wrong", [{"draws": 0}, {"decisions": 0}, {"seeds": ()}, {"episodes": 0}])
def test_a_study_of_nothing_is_refused(wrong):
    with pytest.raises(UserError):
        ahead.Config(**wrong)

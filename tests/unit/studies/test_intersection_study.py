"""The intersection study end to end at a tiny size: jobs, tables, atlas, figures, going on."""

import dataclasses
import json

import pytest
from tests.digest.studies import differs

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.nn.q_policy import QPolicy
from socialiq.settings import changed
from socialiq_lab.intersection import thesis_values
from socialiq_lab.jobs import fingerprints, open_jobs
from socialiq_lab.registry import study_and_declaration
from socialiq_lab.study import run
from studies.intersection.plan import jobs, learner_name, members, policy_file

STUDY, CONTENT = study_and_declaration("intersection")
Config = STUDY.Config
TINY = changed(Config(), CONTENT["tiny"])
OUTCOMES = ("collision", "arrival", "timeout")


def test_no_table_of_the_digest_differs(results, work):
    assert differs(STUDY.name, results, work) == []


def test_every_policy_has_all_its_episodes(results):
    rows = results.tables["policies"]
    assert sum(row["policy"].startswith("experts/") for row in rows) == 3
    assert sum(row["policy"].startswith("learners/") for row in rows) == 3 * 4 * 2 * 2
    for row in rows:
        assert row["episodes"] == TINY.episodes
        assert sum(row[name] for name in OUTCOMES) == pytest.approx(1.0, abs=1e-5)


def test_table_6_2_has_the_thesis_numbers_beside_the_means_of_ours(results):
    rows = [row for row in results.tables["table_6_2"] if row["readout"] == "greedy"]
    by_policy = {(r["policy"], r["readout"]): r for r in results.tables["policies"]}
    for row in rows:
        thesis = thesis_values.TABLE_6_2[row["metric"]][row["policy"]]
        assert (row["thesis"], row["thesis_spread"]) == thesis
        if row["preset"] == "experts":
            assert row["over_training"] == ""  # one training seed
            continue
        names = [
            learner_name(row["preset"], row["setting"], row["policy"], seed) for seed in TINY.seeds
        ]
        factor = 1 if row["metric"] == "speed_kmh" else 100
        ours = [factor * by_policy[name, "greedy"][row["metric"]] for name in names]
        assert row["ours"] == pytest.approx(sum(ours) / 2, abs=1e-4)


def test_the_thesis_table_a_2_follows_from_its_table_a_1(results):
    rows = [row for row in results.tables["table_a_2"] if row["thesis"] != ""]
    assert len(rows) == 9
    for row in rows:
        assert row["thesis_from_a_1"] == pytest.approx(row["thesis"], abs=0.008), row
        pair, signal = f"{row['first']}_{row['second']}", row["signal"]
        assert results.summary["table_a_2"][pair][signal]["ours"] == row["ours"]


def test_policies_of_the_atlas_drive_among_both_kinds_of_neighbours(results, work):
    """The same episodes' seeds, other neighbours: what happens differs."""
    rows = {(row["member"], row["connected"]): row for row in results.tables["connected"]}
    assert len(rows) == 2 * len(members(TINY))
    by_policy = {(r["policy"], r["readout"]): r for r in results.tables["policies"]}
    for member, name in members(TINY).items():
        assert rows[member, "off"]["r_social"] == by_policy[name, "greedy"]["r_social"]
    assert any(rows[m, "off"]["r_social"] != rows[m, "on"]["r_social"] for m, _ in rows)


def test_every_job_has_its_time(results):
    rows = results.tables["times"]
    assert sum(row["number"] for row in rows) == len(jobs(TINY))
    assert all(0 <= row["longest"] <= row["seconds"] for row in rows)
    assert max(row["longest"] for row in rows) > 0


def test_the_atlas_is_the_policies_that_were_evaluated(results, work):
    manifest = json.loads(results.files["atlas/manifest.json"])["policies"]
    assert set(manifest) == set(members(TINY))
    for name, entry in manifest.items():
        assert (
            results.files[f"atlas/{entry['file']}"]
            == (work / entry["job"] / policy_file(entry["job"])).read_bytes()
        )
        policy = QPolicy.load(work / entry["job"] / policy_file(entry["job"]))
        assert policy.sha256 == entry["sha256"], name


def test_a_second_call_does_nothing_and_gives_the_same(results, work):
    before = {path: path.stat().st_mtime_ns for path in work.rglob("job.json")}
    again = run(STUDY, TINY, work=work)
    assert {path: path.stat().st_mtime_ns for path in work.rglob("job.json")} == before
    assert again.summary == results.summary


def test_only_what_a_change_touches_is_done_again(results, work):
    planned = jobs(dataclasses.replace(TINY, episodes=30))
    assert {job.stage for job in open_jobs(planned, work)} == {"evaluation", "connected"}
    planned = jobs(dataclasses.replace(TINY, pool_episodes=13))
    assert {job.stage for job in open_jobs(planned, work)} == {
        "demonstrations",
        "learners",
        "evaluation",
        "connected",
    }


def test_results_are_saved_with_the_atlas_and_drawn_from_the_files(results, tmp_path):
    store.save(results, tmp_path / "out", {}, replace=False)
    assert (tmp_path / "out" / "atlas" / "baseline.safetensors").is_file()
    read = store.load(tmp_path / "out")
    assert read.summary == results.summary
    assert {"fig_6_5_ring", "table_6_2", "tradeoff", "fig_a_1"} <= set(STUDY.figures(read))


def test_the_whole_plan_has_jobs_of_distinct_names_after_their_inputs():
    planned = jobs(Config())
    fingerprints(planned)  # refuses a name that is there twice
    seen = set()
    for job in planned:
        assert {*job.inputs} <= seen, job.name
        seen.add(job.name)


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"parts": ("mian",)}, "unknown part 'mian'"),
        ({"episodes": 0}, "episodes must be at least 1"),
        ({"seeds": ()}, "seeds must name at least one"),
    ],
)
def test_a_wrong_configuration_is_refused(values, line):
    with pytest.raises(UserError, match=line):
        jobs(Config(**values))


def test_settings_of_experts_and_learners_reach_every_run_of_the_main_part():
    """A part that varies a setting keeps its own values of it."""
    values = {
        "parts": "main,strengths",
        "expert.through_timeouts": "true",
        "learner.strength": "2",
        "learner.temperature": "0.5",
        "learner.target_kind": "to_go",
    }
    planned = {job.name: job.config for job in jobs(changed(TINY, values))}
    for name, config in planned.items():
        if name.startswith("experts/"):
            assert config.structure.through_timeouts
        if name.startswith("learners/"):
            assert config.structure.target_kind == "to_go"
            assert (config.numbers.temperature, config.numbers.strength) == (0.5, 2.0)
    parts = [config for name, config in planned.items() if name.startswith("strengths/")]
    assert {config.numbers.strength for config in parts} == {0.3, 1.0, 2.0, 3.0, 5.0, 10.0}


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("learner.lambda", "2", "there is no setting lambda: choose one of"),
        ("learner.temperature", "hot", "temperature must be a number, got 'hot'"),
        ("learner.target_kind", "none", "unknown target_kind 'none': choose one of running, to_go"),
        ("learner", "3", r"choose one of learner\.KEY=VALUE"),
        ("learner.updates", "4", r"learner\.updates is decided by the study"),
        ("expert.nosuch", "1", "there is no setting nosuch: choose one of activation, batch_size"),
    ],
)
def test_a_wrong_setting_of_a_learner_is_refused_before_any_work(key, value, line):
    with pytest.raises(UserError, match=line):
        changed(Config(), {key: value})

"""The study of the experts' strength: which check of a training is kept, and its tables."""

import pytest
from tests.digest.studies import differs

from socialiq.learners import dqn
from socialiq.settings import changed
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.training import ExpertRun
from socialiq_lab.jobs import fingerprints
from socialiq_lab.registry import study_and_declaration
from socialiq_lab.study import run
from socialiq_lab.tables import matching

STUDY, CONTENT = study_and_declaration("expert-strength")
TINY = changed(STUDY.Config(), CONTENT["tiny"])


def test_the_best_check_has_the_highest_value_or_the_nearest_endings():
    config = ExpertRun(dqn.DQNConfig(), dqn.DQNHyperparameters())
    near = {"total": 1.0, "collision": 0.3, "arrival": 0.6, "timeout": 0.1}
    far = {"total": 2.0, "collision": 0.1, "arrival": 0.9, "timeout": 0.0}
    assert config.merit(far) > config.merit(near)
    wanted = {"collision": 0.29, "arrival": 0.7, "timeout": 0.01}
    stopped = ExpertRun(config.structure, config.numbers, nearest=wanted)
    assert stopped.merit(near) > stopped.merit(far)
    assert stopped.merit(wanted) == 0.0


def test_the_whole_plan_has_jobs_of_distinct_names_after_their_inputs():
    planned = list(STUDY.jobs(STUDY.Config()))
    assert fingerprints(planned)  # refuses a name that is there twice, and an input that is later
    learners = [job for job in planned if job.name.startswith("learners/matched/")]
    config = STUDY.Config()
    assert len(learners) == len(config.trios) * len(config.seeds) * 4


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    return tmp_path_factory.mktemp("tiny") / "work"


@pytest.fixture(scope="module")
def results(work):
    return run(STUDY, TINY, work=work)


@pytest.mark.slow
def test_no_table_of_the_digest_differs(results, work):
    assert differs(STUDY.name, results, work) == []


@pytest.mark.slow
def test_tables_have_a_row_for_each_trio_or_its_mean(results):
    cells = results.tables["table_6_2"]
    assert {row["policy"] for row in cells} == set(thesis_values.POLICIES)
    assert all(row["trios"] == len(TINY.trios) for row in cells)
    by_policy = {row["policy"]: row for row in results.tables["policies"]}
    names = [f"experts/matched/{trio}/egoistic" for trio in TINY.trios]
    (cell,) = matching(cells, policy="expert egoistic", metric="collision")
    rates = [100 * by_policy[name]["collision"] for name in names]
    assert cell["ours"] == pytest.approx(sum(rates) / len(rates), abs=1e-4)
    assert {row["strength"] for row in results.tables["strength"]} >= {"weak", "matched", "strong"}


@pytest.mark.slow
def test_the_reading_with_the_least_score_trains_learners_unless_it_is_the_default(results):
    table = results.tables["readings"]
    best = min(table, key=lambda row: row["score"])["reading"]
    learned = {row["policy"] for row in results.tables["policies"]}
    trained = any(name.startswith("learners/reading/") for name in learned)
    assert trained == (best != "default")

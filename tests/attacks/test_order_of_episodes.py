"""Attack: a policy with a memory drives well in the first episodes and badly in the rest.

Its mean loss is beyond the margin, and the bound had decided before the rest counted.
"""

import csv
import io

import numpy as np
import pytest

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.report.content import content
from socialiq.audit.report.folder import REPORT
from socialiq.audit.report.recompute import audited_of
from socialiq.audit.report.verify import content_of, read_report
from socialiq.audit.verdict.results import order_dependence
from socialiq.evaluation.measures import Episodes

SAME = {name: {"queries": 1000, "differing": 0} for name in ("repeated", "shuffled", "single")}


def audited_with(folder, lost):
    """Return the report of a process that lost so much in each episode."""
    files, report = content_of(folder), read_report(folder / REPORT)
    rows = list(csv.reader(io.StringIO(files["episodes.csv"].decode())))
    column = rows[0].index("policy.r_env")
    for row, loss in zip(rows[1:], lost, strict=True):
        row[column] = repr(float(row[column]) - float(loss))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    report["policy"]["record"]["kind"] = "process"
    report["consistency"] = SAME
    return content(audited_of({**files, "episodes.csv": text.getvalue().encode()}, report))


@pytest.mark.parametrize("share", [0.5, 0.7])
def test_good_episodes_first_are_no_pass(passed, share):
    lost = np.where(np.arange(200) < share * 200, 0.0, 2.1 / (1.0 - share))
    verdict = audited_with(passed, lost)["verdict"]
    assert verdict["decision"] == "inconclusive"
    assert "order of the episodes" in verdict["reason"]


SHAPES = {
    "constant": lambda rng, rows: np.full(rows, 0.1),
    "constant but for rounding": lambda rng, rows: 0.3 + rng.choice([0.0, 5e-17], rows),
    "two values": lambda rng, rows: rng.choice([0.1, 0.7], rows, p=[0.9, 0.1]),
    "one rare value": lambda rng, rows: 0.1 - 100.0 * (rng.random(rows) < 0.01),
    "all different": lambda rng, rows: rng.normal(size=rows),
}


def found(draw, rng, rows, audits):
    """Return in how many audits rewards of these draws are found to depend on the order."""
    ends = {"ending": np.zeros(rows, np.int64), "contact": np.zeros(rows, np.int64)}
    ends["length"] = np.ones(rows, np.int64)
    accused = 0
    for _ in range(audits):
        totals = draw(rng, rows), draw(rng, rows)
        drivers = [
            Outcomes(name, Episodes({"r_env": env, "r_social": social, **ends}))
            for name, env, social in (
                ("policy", *totals),
                ("reference", np.full(rows, 0.7), np.full(rows, 0.2)),
            )
        ]
        driven = Evidence("made up", np.arange(rows), drivers[0], (drivers[1],), {})
        accused += order_dependence(driven) != ""
    return accused


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("rows", [20, 500])
def test_policies_without_a_memory_are_hardly_accused_of_one(shape, rows):
    """Of 1,000 policies at most 1 is expected, and 5 come in 0.4 % of runs.

    Before, 82 to 100 % of those of constant rewards were.
    """
    assert found(SHAPES[shape], np.random.default_rng([rows, len(shape)]), rows, 1000) <= 5


def autoregressive(rng, rows):
    values = rng.normal(size=rows)
    for row in range(1, rows):
        values[row] = 0.5 * values[row - 1] + 0.75**0.5 * values[row]
    return values


MEMORIES = {
    "half of the last episode": autoregressive,
    "blocks of five": lambda rng, rows: np.repeat(rng.normal(size=rows // 5), 5),
    "every fifth": lambda rng, rows: 0.1 * rng.normal(size=rows) - (np.arange(rows) % 5 == 0),
}


@pytest.mark.parametrize("memory", MEMORIES)
def test_a_memory_of_the_last_episodes_is_found(memory):
    """Before, 12 % of the first, 30 % of the second and none of the third were."""
    assert found(MEMORIES[memory], np.random.default_rng(7), 500, 20) == 20


def test_the_same_losses_in_any_order_are_judged_by_their_mean(passed):
    lost = np.random.default_rng(0).permutation(np.where(np.arange(200) < 100, 0.0, 1.0))
    assert audited_with(passed, lost)["verdict"]["decision"] == "pass"

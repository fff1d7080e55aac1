"""Attack: a policy with a memory drives well in the first episodes and badly in the rest.

Its mean loss is beyond the margin, and the bound had decided before the rest counted.
"""

import csv
import io

import numpy as np
import pytest

from socialiq.audit.report.content import content
from socialiq.audit.report.folder import REPORT
from socialiq.audit.report.recompute import audited_of
from socialiq.audit.report.verify import content_of, read_report

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


def test_the_same_losses_in_any_order_are_judged_by_their_mean(passed):
    lost = np.random.default_rng(0).permutation(np.where(np.arange(200) < 100, 0.0, 1.0))
    assert audited_with(passed, lost)["verdict"]["decision"] == "pass"

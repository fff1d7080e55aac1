"""Attack: a decision, a bound, a table or an episode is changed, and all hashes are made again.

No one has the policy for a rerun. It worked: `audit verify` without `--rerun` found nothing.
"""

import csv
import io
import json

import pytest
from tests.attacks.conftest import recomputed

from socialiq.cli.main import main


def decision(report):
    report["verdict"] |= {"decision": "pass", "exit_code": 0}


def bound(report):
    report["tests"]["regret"]["low"] /= 2


def reference(report):
    report["references"][0]["r_env"] += 0.001


def kind_of_episode(report):
    report["strata"][0]["shares"]["arrival"]["value"] = 1.0


def worst_episode(report):
    report["episodes"]["worst"][0]["r_social"] += 1.0


def point_of_the_picture(report):
    report["cloud"][0][0] += 1.0


def caveat(report):
    report["caveats"].clear()


def limit(report):
    report["limits"].pop()


def margin(report):
    report["declaration"]["margin"]["regret"] *= 2


def bound_of_an_effect(report):
    report["tests"]["competence"][4]["high"] += 1.0


def declared_bound(report):
    report["declaration"]["caused"][0]["limit"] *= 2


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (bound_of_an_effect, "report.tests.competence[4].high"),
        (declared_bound, "report.declaration.caused[0].limit"),
        (decision, "report.verdict.decision"),
        (bound, "report.tests.regret.low"),
        (reference, "report.references[0].r_env"),
        (kind_of_episode, "report.strata[0].shares.arrival.value"),
        (worst_episode, "report.episodes.worst[0].r_social"),
        (point_of_the_picture, "report.cloud[0][0]"),
        (caveat, "report.caveats"),
        (limit, "report.limits"),
        (margin, "report.declaration.margin.regret"),
    ],
)
def test_a_field_of_the_report(failed, reseal, tmp_path, capsys, change, field):
    copy = reseal(failed, tmp_path / "forged", change)
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    assert field in capsys.readouterr().err


def changed_rows(folder, change):
    rows = list(csv.reader(io.StringIO((folder / "episodes.csv").read_text())))
    for row in rows[1:]:
        change(rows[0], row)
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def better(head, row):
    """Give the policy the first reference's rewards and ending."""
    first, at = head.index("optimum_00.r_env"), head.index("policy.r_env")
    row[at : at + 4] = row[first : first + 4]


def test_rewards_of_the_episodes(failed, reseal, tmp_path, capsys):
    forged = changed_rows(failed, better)
    assert forged != (failed / "episodes.csv").read_bytes()
    copy = reseal(failed, tmp_path / "forged", lambda _: None, episodes_csv=forged)
    capsys.readouterr()
    assert main(["audit", "verify", str(copy), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["faults"]
    assert "report.tests.regret.regret does not follow from the episodes" in found
    assert "report.verdict.decision does not follow from the episodes" in found


@pytest.mark.slow
def test_episodes_made_up_consistently_need_a_rerun(failed, reseal, tmp_path, capsys):
    """The verdict of a pass follows from them, so only running them again, or its signer, helps."""
    forged = changed_rows(failed, better)
    made_up = reseal(failed, tmp_path / "made up", lambda _: None, episodes_csv=forged)
    fresh = recomputed(made_up)
    copy = reseal(made_up, tmp_path / "forged", lambda report: report.update(fresh))
    assert fresh["verdict"]["decision"] == "pass"
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 0
    assert "left to believe: the episodes and answers of the policy" in capsys.readouterr().out
    assert main(["audit", "verify", str(copy), "--rerun"]) == 1
    assert "episodes.csv differs in the rerun" in capsys.readouterr().err


def test_other_seeds_of_the_episodes(failed, reseal, tmp_path, capsys):
    """The episodes were chosen: their seeds don't follow from the audit's seed."""

    def other(head, row):
        row[head.index("seed")] = str(int(row[head.index("seed")]) + 1)

    forged = changed_rows(failed, other)
    copy = reseal(failed, tmp_path / "forged", lambda _: None, episodes_csv=forged)
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    assert "episodes.csv" in capsys.readouterr().err


def test_episodes_that_are_left_away(failed, reseal, tmp_path, capsys):
    """The worst half of the episodes is missing."""
    text = (failed / "episodes.csv").read_text().splitlines(keepends=True)
    forged = "".join(text[:101]).encode()
    copy = reseal(failed, tmp_path / "forged", lambda _: None, episodes_csv=forged)
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    assert "episodes.csv" in capsys.readouterr().err

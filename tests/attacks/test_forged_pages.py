"""Attack: a failed audit is given the pages of a passed one, and hides behind another version.

The package's hash in the report is set to zeros, so that no page seems to be comparable, and all
hashes are made again. It worked: `audit verify --rerun` said "as it was written, and repeats".
"""

import json

from socialiq.cli.main import main

ZEROS = 64 * "0"


def test_the_pages_of_a_passed_audit(failed, passed, reseal, tmp_path, capsys):
    copy = reseal(
        failed,
        tmp_path / "forged",
        lambda report: report["hashes"].update(package=ZEROS),
        report_html=(passed / "report.html").read_bytes(),
        report_md=(passed / "report.md").read_bytes(),
    )
    capsys.readouterr()
    for more in ([], ["--rerun"]):
        assert main(["audit", "verify", str(copy), *more]) == 3
        said = capsys.readouterr().out
        assert "not checked" in said.splitlines()[0]
        assert "report.html" in said and "report.md" in said
        assert "as it was written" not in said and "is consistent" not in said
    assert main(["audit", "verify", str(copy), "--json"]) == 3
    assert "report.html" in str(json.loads(capsys.readouterr().out)["not_checked"])


def test_the_whole_report_of_a_passed_audit(failed, passed, reseal, tmp_path, capsys):
    """All of report.json from the passed audit, beside the failed one's episodes."""
    better = json.loads((passed / "report.json").read_bytes())
    better["hashes"]["package"] = ZEROS
    copy = reseal(failed, tmp_path / "forged", lambda report: report.update(better))
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    assert "episodes.csv" in capsys.readouterr().err


def test_the_decision_in_the_report_too(failed, reseal, tmp_path, capsys):
    """The decision, its reason, and the bounds of a pass; pages made from that report."""

    def pass_it(report):
        regret = report["tests"]["regret"]
        report["hashes"]["package"] = ZEROS
        report["verdict"] |= {"decision": "pass", "reason": "It keeps its word.", "exit_code": 0}
        regret |= {"decision": "pass", "regret": 0.1, "low": 0.0, "high": 0.2}

    copy = reseal(failed, tmp_path / "forged", pass_it)
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    captured = capsys.readouterr()
    assert "report.verdict.decision" in captured.err
    assert "is consistent" not in captured.out

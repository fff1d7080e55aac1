"""Bounds of effects in a report: the verdict's words and units, its tables, and its files."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import socialiq.audit.report as package
from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.replay import selected
from socialiq.audit.profile.fields import QUANTITIES
from socialiq.audit.profile.profile import Bound, Floor
from socialiq.audit.report.content import content
from socialiq.audit.report.documents import materials
from socialiq.audit.report.folder import files_of, views_of, write_folder
from socialiq.audit.report.verify import fault_of, faults
from socialiq.audit.report.views import by_class
from socialiq.audit.seeds import Commitment, episode_seeds

SCHEMA = json.loads((Path(package.__file__).parent / "report.schema.json").read_text())


class Always:
    """Chooses one action."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(len(observation), 1), state


@pytest.fixture(scope="module", params=["at most", "at least"])
def bounded(request, declared, audited):
    """The audit of the package with a bound of the delay, which the policy keeps, or fails."""
    limit = 8.0 if request.param == "at most" else 4.0
    bound = Bound("delay", request.param, limit, (-2.0, 12.0))
    profile = declared("crossing7", 0.0, competence=Floor(1.0, 1.0, 0.0, 1.0), caused=(bound,))
    drawn = dataclasses.replace(
        audited.drawn, commitment=Commitment(audited.drawn.commitment.policy_sha256, profile.sha256)
    )
    seeds = episode_seeds(drawn.derived("episodes"), 60)
    evidence = collect_evidence(profile.world(), Always(), seeds, measured=profile.effects)
    return dataclasses.replace(
        audited,
        profile=profile,
        drawn=drawn,
        evidence=[evidence],
        traffic=(),
        episodes=selected(evidence, 0.0),
        traces={"median": [None] * 3, "worst": [None] * 3},
    )


def test_the_verdict_box_names_the_effect_with_its_unit(bounded, tmp_path):
    report = json.loads(json.dumps(content(bounded)))
    assert fault_of(report, SCHEMA) == ""
    test = report["tests"]["competence"][-1]
    kept = test["side"] == "at most"
    assert (test["name"], test["decision"]) == ("delay", "pass" if kept else "fail")
    mean = bounded.evidence[0].policy.episodes["delay"].mean()
    assert test["share"] == report["policy"]["means"]["caused"]["delay"] == pytest.approx(mean)
    assert report["declaration"]["caused"][0]["range"] == [-2.0, 12.0]
    reason = report["verdict"]["reason"]
    words = f"costs others at most {test['high']:.3g} cells an episode"
    if kept and report["verdict"]["decision"] == "pass":
        assert f"It {words} (declared: at most 8 cells)." in reason
    if not kept:
        assert f"it {words} (at least 4 cells needed)" in reason
    pages = views_of(report)
    for name in ("report.html", "report.md", "annex-iv.md", "nist-ai-rmf.md"):
        page = pages[name].decode()
        assert "costs others" in page and " cells" in page, name
    assert reason.split(" (")[0] in pages["report.html"].decode()
    assert "The safety floor and the bounds of effects are kept" in pages["safety-case.md"].decode()
    assert b"delay per episode, cells" in materials(report)
    write_folder(tmp_path / "audit", files_of(report, bounded.profile, bounded.evidence), False)
    assert faults(tmp_path / "audit") == []


def test_episodes_beyond_the_range_are_counted(bounded):
    profile = dataclasses.replace(
        bounded.profile, caused=(Bound("delay", "at most", 0.5, (0.0, 1.0)),)
    )
    report = content(dataclasses.replace(bounded, profile=profile))
    cut = int((bounded.evidence[0].policy.episodes["delay"] > 1.0).sum())
    assert report["tests"]["competence"][-1]["count"] == cut > 0
    (caveat,) = [row["text"] for row in report["caveats"] if row["about"] == "clip"]
    assert f"the delay of an episode from 0 to 1 cells. This changed {cut} of 60 episodes" in caveat


def test_reports_may_have_every_effect():
    assert SCHEMA["$defs"]["effect"]["enum"] == list(QUANTITIES)


def test_a_report_without_bounds_has_no_field_of_them(report):
    assert "caused" not in report["declaration"] and "caused" not in report["policy"]["means"]
    assert len(report["tests"]["competence"]) == 4


def test_a_policy_that_obstructs_people_fails_by_their_line(declared, audited):
    world, limits = "intersection-crosswalk", {"max_delay": 300.0, "max_waiting": 1.5}
    ranges = {"max_delay": (-700.0, 700.0), "max_waiting": (0.0, 30.0)}
    caused = tuple(Bound.of(name, limit, ranges[name]) for name, limit in limits.items())
    profile = declared(world, 45.0, competence=Floor(1.0, 1.0, 0.0, 1.0), caused=caused)
    seeds = episode_seeds(7, 120)
    driver = profile.world().driver("gap_3s")
    evidence = collect_evidence(profile.world(), driver, seeds, measured=profile.effects)
    obstructs = dataclasses.replace(
        audited,
        profile=profile,
        evidence=[evidence],
        traffic=(),
        episodes=selected(evidence, 0.0),
        traces={"median": [None] * 3, "worst": [None] * 3},
    )
    report = json.loads(json.dumps(content(obstructs)))
    vehicles, people = by_class(report)
    assert report["verdict"]["decision"] == "fail"
    assert (vehicles["class"], vehicles["result"]) == ("vehicles", "kept")
    assert (people["class"], people["result"]) == ("pedestrians", "broken")
    assert people["asked for"] == "at most 1.5 s"
    first = views_of(report)["report.html"].decode().split("What was tested")[0]
    for cell in ("pedestrians", people["estimate"], f"{people['low']} to {people['high']}"):
        assert cell in first
    del report["tests"]["competence"][-1]
    assert b"no bound is declared" in views_of(report)["report.html"]
    assert by_class(report)[-1]["name"] == "no bound is declared"

"""Credibility of the simulation: only what is known, the rest visibly blank."""

import copy
import json

import pytest

from socialiq.audit.report.documents import credibility, materials
from socialiq.audit.report.folder import views_of
from socialiq.audit.report.words import stated

SUBJECTS = [
    "Scope",
    "Assumptions",
    "Uncertainty",
    "Numerical validation",
    "Validation against reality",
    "Limits",
]

CONFORMANCE = stated()["conformance"]


def page(report):
    return views_of(report)["credibility.md"].decode()


def section(text, title):
    return text.split(f"\n## {title}\n")[1].split("\n## ")[0]


def in_world(plain, world, **options):
    report = copy.deepcopy(plain)
    report["declaration"]["scenario"] |= {"world": world, "options": options}
    return report


def test_subjects_and_places_for_the_assessor(plain):
    text = page(plain)
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == SUBJECTS
    assert "**[ blank ]**" in section(text, "Scope")
    assert "**[ blank ]**" in section(text, "Validation against reality")
    assert "not an assessment" in text


def test_a_gridworlds_references_are_exact(plain):
    text = section(page(plain), "Numerical validation")
    assert "dynamic programming" in text and "highway-env" not in text


def test_the_intersection_was_compared_with_highway_env(plain):
    found = section(page(in_world(plain, "intersection")), "Numerical validation")
    assert f"{CONFORMANCE['episodes']} episodes, {CONFORMANCE['decisions']} decisions" in found
    assert CONFORMANCE["command"] in found and "left at their defaults" not in found


def test_options_that_were_not_compared_are_named(plain):
    report = in_world(plain, "intersection", population="thesis", duration=10.0)
    assert credibility(report)["beyond"] == ["duration"]
    assert "left at their defaults: duration" in page(report)


def test_of_an_environment_nothing_is_known(plain):
    text = page(in_world(plain, "mine.py:Road"))
    for title in ("Assumptions", "Numerical validation", "Validation against reality"):
        assert section(text, title).strip().startswith("> **[ blank ]**"), title


def test_other_traffic_is_examined_or_said_not_to_be(plain):
    assert plain["shift"]["sentence"][:20] in section(page(plain), "Uncertainty")
    plain["shift"] = None
    assert "not examined in this audit" in section(page(plain), "Uncertainty")


@pytest.mark.parametrize("word", ["conforms", "complies", "compliant", "approved", "certified"])
def test_nothing_states_conformity(plain, word):
    for world in ("crossing7", "intersection", "mine.py:Road"):
        assert word not in page(in_world(plain, world))


def test_the_numbers_are_those_of_the_documentation():
    """The run of docs/worlds/intersection.md."""
    from pathlib import Path

    text = Path("docs/worlds/intersection.md").read_text()
    assert CONFORMANCE["command"] in " ".join(text.split())
    assert f"{CONFORMANCE['episodes']} episodes, {CONFORMANCE['decisions']:,} decisions" in text


def test_it_has_the_policy_and_the_results_of_its_audit(plain):
    (model,) = json.loads(materials(plain))["components"]
    assert model["name"] == plain["policy"]["record"]["source"]
    assert model["hashes"] == [{"alg": "SHA-256", "content": plain["hashes"]["policy"]}]
    facts = {one["name"]: one["value"] for one in model["properties"]}
    assert facts["socialiq:decision"] == plain["verdict"]["decision"]
    assert facts["socialiq:scenario-sha256"] == plain["hashes"]["scenario"]
    metrics = model["modelCard"]["quantitativeAnalysis"]["performanceMetrics"]
    regret, *floor = metrics
    assert regret["value"] == f"{plain['tests']['regret']['regret']:.6g}"
    assert regret["confidenceInterval"]["upperBound"] == f"{plain['tests']['regret']['high']:.6g}"
    assert [one["type"] for one in floor] == [
        f"share of {one['name']}" for one in plain["tests"]["competence"]
    ]
    assert model["modelCard"]["considerations"]["technicalLimitations"] == plain["limits"]


def test_code_is_not_one_file_so_its_hash_is_a_fact_and_no_files_hash(plain):
    plain["policy"]["record"]["kind"] = "process"
    (model,) = json.loads(materials(plain))["components"]
    facts = {one["name"]: one["value"] for one in model["properties"]}
    assert "hashes" not in model and facts["socialiq:sha256"] == plain["hashes"]["policy"]


def test_it_is_a_file_of_the_folder_that_follows_from_the_report(plain):
    assert views_of(plain)["ml-bom.cdx.json"] == materials(plain)

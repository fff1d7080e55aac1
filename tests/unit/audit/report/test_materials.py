"""Bill of materials of an audited policy."""

import json

from socialiq.audit.report.documents import materials
from socialiq.audit.report.folder import views_of


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

"""Bills of materials by the official schema of CycloneDX 1.7, strictly."""

import json

import pytest

from socialiq.cli.main import main
from socialiq.policies.card import Metric, bill_of_materials
from socialiq.worlds.intersection import atlas

pytest.importorskip("cyclonedx", reason="extra `bom` is not installed")


def fault(text):
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    return JsonStrictValidator(SchemaVersion.V1_7).validate_str(text)


def test_the_schema_accepts_every_field_and_would_not_accept_another():
    full = bill_of_materials(
        "<a> policy",
        "1",
        file_sha256="ab" * 32,
        architecture="network",
        inputs="5 numbers",
        outputs="one of 3",
        data={"a": "b"},
        metrics=[Metric("regret", "1", "0", "2"), Metric("r", "1")],
        limits=["One road."],
        properties={"socialiq:x": "y"},
    )
    for content in (full, bill_of_materials("a", "1")):
        assert fault(content.decode()) is None
    wrong = json.loads(full)
    wrong["components"][0]["modelCard"]["conformity"] = True
    assert fault(json.dumps(wrong)) is not None


def test_an_audit_writes_one(tmp_path):
    new = ["profile", "new", "--world", "intersection", "--angle", "0", "--margin", "2"]
    assert main([*new, "--out", str(tmp_path / "p.toml")]) == 0
    words = ["audit", "wait", "--profile", str(tmp_path / "p.toml"), "--episodes", "20"]
    assert main([*words, "--out", str(tmp_path / "a")]) in (0, 1, 3)
    assert fault((tmp_path / "a" / "ml-bom.cdx.json").read_text()) is None


def test_export_writes_one_beside_the_card(tmp_path):
    out = tmp_path / "policy.cdx.json"
    assert main(["export", atlas.names()[0], "--format", "bom", "--out", str(out)]) == 0
    assert fault(out.read_text()) is None
    (model,) = json.loads(out.read_text())["components"]
    assert model["modelCard"]["quantitativeAnalysis"]["performanceMetrics"]

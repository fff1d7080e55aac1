"""Bills of materials: CycloneDX 1.7 with a model card, the same for the same facts."""

import json
import uuid

from socialiq.policies.card import Metric, bill_of_materials


def made(**more):
    return json.loads(bill_of_materials("a policy", "1.2.3", **more))


def test_the_component_is_a_model_with_its_hash_and_its_card():
    content = made(
        file_sha256="ab" * 32,
        architecture="network 5-8-3, relu",
        inputs="5 numbers",
        outputs="one of 3 actions",
        data={"data.file": "d.safetensors"},
        metrics=[Metric("regret", "0.5", "0.1", "0.9"), Metric("r_env", "2")],
        limits=["One road."],
        properties={"socialiq:world": "crossing7"},
    )
    assert (content["bomFormat"], content["specVersion"]) == ("CycloneDX", "1.7")
    (model,) = content["components"]
    assert (model["type"], model["name"]) == ("machine-learning-model", "a policy")
    assert model["hashes"] == [{"alg": "SHA-256", "content": "ab" * 32}]
    assert model["properties"] == [{"name": "socialiq:world", "value": "crossing7"}]
    card = model["modelCard"]
    (data,) = card["modelParameters"]["datasets"]
    assert data["contents"]["properties"] == [{"name": "data.file", "value": "d.safetensors"}]
    assert card["quantitativeAnalysis"]["performanceMetrics"] == [
        {
            "type": "regret",
            "value": "0.5",
            "confidenceInterval": {"lowerBound": "0.1", "upperBound": "0.9"},
        },
        {"type": "r_env", "value": "2"},
    ]
    assert card["considerations"]["technicalLimitations"] == ["One road."]


def test_what_is_not_known_is_left_out():
    (model,) = made()["components"]
    assert "hashes" not in model and "properties" not in model
    assert list(model["modelCard"]) == ["modelParameters"]
    assert list(model["modelCard"]["modelParameters"]) == ["task"]


def test_the_same_facts_give_the_same_bytes_and_others_another_number():
    assert bill_of_materials("a", "1") == bill_of_materials("a", "1")
    one, other = made(), made(limits=["x"])
    assert one["serialNumber"] != other["serialNumber"]
    assert uuid.UUID(one["serialNumber"].removeprefix("urn:uuid:")).version == 5
    assert "timestamp" not in one["metadata"]

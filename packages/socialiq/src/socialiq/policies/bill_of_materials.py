"""Bill of materials of a policy: CycloneDX 1.7 with a model card, as JSON.

https://cyclonedx.org/docs/1.7/json: a component of the type machine-learning-model. The result
depends on its arguments alone: the serial number is derived from them, and there is no time.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "https://socialiq.example/bill-of-materials/1")
"""A name; not an address."""


@dataclass(frozen=True)
class Metric:
    """A measured number, with its interval if there is one."""

    type: str
    value: str
    low: str | None = None
    high: str | None = None

    def as_json(self) -> dict[str, Any]:
        """Return it as a `performanceMetric`."""
        found: dict[str, Any] = {"type": self.type, "value": self.value}
        if self.low is not None and self.high is not None:
            found["confidenceInterval"] = {"lowerBound": self.low, "upperBound": self.high}
        return found


def bill_of_materials(
    name: str,
    version: str,
    *,
    file_sha256: str = "",
    architecture: str = "",
    inputs: str = "",
    outputs: str = "",
    data: Mapping[str, str] | None = None,
    metrics: Sequence[Metric] = (),
    limits: Sequence[str] = (),
    properties: Mapping[str, str] | None = None,
) -> bytes:
    """Return a bill of materials of one policy.

    Args:
        name: Name of the policy.
        version: Version of socialiq that wrote it.
        file_sha256: SHA-256 of the policy's file, if it is one file.
        architecture: Architecture of the network, if known.
        inputs: Form of an observation.
        outputs: Form of an action.
        data: Facts about the training data; none if they are not known.
        metrics: Measured numbers.
        limits: Known limitations, as sentences.
        properties: Further facts, by names of this package's own ("socialiq:...").
    """
    component: dict[str, Any] = {
        "bom-ref": "policy",
        "type": "machine-learning-model",
        "name": name,
        "modelCard": _card(architecture, inputs, outputs, data, metrics, limits),
    }
    if file_sha256:
        component["hashes"] = [{"alg": "SHA-256", "content": file_sha256}]
    if properties:
        component["properties"] = _properties(properties)
    tool = {"type": "application", "name": "socialiq", "version": version}
    content = {
        "$schema": "http://cyclonedx.org/schema/bom-1.7.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.7",
        "version": 1,
        "metadata": {"tools": {"components": [tool]}},
        "components": [component],
    }
    text = json.dumps(content, sort_keys=True, allow_nan=False)
    content["serialNumber"] = f"urn:uuid:{uuid.uuid5(_NAMESPACE, text)}"
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def _card(
    architecture: str,
    inputs: str,
    outputs: str,
    data: Mapping[str, str] | None,
    metrics: Sequence[Metric],
    limits: Sequence[str],
) -> dict[str, Any]:
    parameters: dict[str, Any] = {"task": "choose the action of a vehicle for an observation"}
    parameters |= {"modelArchitecture": architecture} if architecture else {}
    if data:
        known = {"properties": _properties(data)}
        row = {"type": "dataset", "name": "training data", "contents": known}
        parameters["datasets"] = [row]
    parameters |= {"inputs": [{"format": inputs}]} if inputs else {}
    parameters |= {"outputs": [{"format": outputs}]} if outputs else {}
    found: dict[str, Any] = {"modelParameters": parameters}
    if metrics:
        rows = [one.as_json() for one in metrics]
        found["quantitativeAnalysis"] = {"performanceMetrics": rows}
    if limits:
        found["considerations"] = {"technicalLimitations": list(limits)}
    return found


def _properties(facts: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "value": value} for name, value in facts.items()]

"""Model card and bill of materials: the recorded facts about a policy, and visible blanks.

A card is Markdown with YAML front matter, as model hubs read it. User-provided names are escaped,
so that they cannot change the card's structure. A bill of materials is CycloneDX 1.7 with a model
card, as JSON (https://cyclonedx.org/docs/1.7/json): a component of the type machine-learning-model.
It depends on its arguments alone: the serial number is derived from them, and there is no time.
"""

import importlib.metadata
import json
import math
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import Markdown, one_line, templates
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy, members_of
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import OneHot
from socialiq.policies.interface import Interface
from socialiq.worlds.situation import ContextPolicy

Exported = QPolicy | EnsemblePolicy | ActorPolicy | ContextPolicy
"""Policies that are exported."""

BLANK = "**[ blank ]**"
MOST_ROWS = 300
"""Settings that a card lists."""


def model_card(
    policy: Exported,
    name: str,
    *,
    training: Mapping[str, Any] | None = None,
    evaluation: Mapping[str, Any] | None = None,
    evaluated_by: str = "",
) -> str:
    """Return a card in Markdown of a policy, whose provenance has the angle and the procedure.

    Args:
        policy: The policy.
        name: Its name.
        training: Further records of its training: the content of `run.json`, or its entry in the
            atlas' manifest. Only `data`, `inputs`, `world`, `versions`, `made_by` and `options`
            count.
        evaluation: One flat object of names and numbers, as `socialiq evaluate --json` prints it.
        evaluated_by: Origin of the evaluation, in words.

    Raises:
        UserError: If the evaluation is not such an object.
    """
    facts = dict(training or {})
    measured = _measured(evaluation)
    record = dict(policy.provenance)
    angle = trained_angle(record)
    size = policy.action_size if isinstance(policy, ActorPolicy) else 0
    return (
        templates("socialiq.policies", most=200)
        .get_template("card.md.j2")
        .render(
            front=Markdown(_front(name, angle, facts, measured)),
            name=name,
            policy=policy,
            chosen=Interface(policy.n_features, policy.n_actions, size).answer,
            angle=angle,
            blank=Markdown(BLANK),
            details=_details(policy, facts),
            data=[*_rows(facts.get("data"), "data"), *_rows(facts.get("inputs"), "inputs")],
            procedure=list(_rows(record, "")),
            evaluation=[(key, _text(value)) for key, value in measured.items()],
            evaluated=evaluated_by or "As given with this card.",
        )
    )


def card_materials(
    policy: Exported,
    name: str,
    *,
    file_sha256: str = "",
    training: Mapping[str, Any] | None = None,
    evaluation: Mapping[str, Any] | None = None,
) -> bytes:
    """Return the facts of a card as a bill of materials, CycloneDX 1.7.

    Args:
        policy: The policy.
        name: Its name.
        file_sha256: SHA-256 of its file; "" leaves it out.
        training: Further records of its training, as in `model_card`.
        evaluation: One flat object of names and numbers, as in `model_card`.

    Returns:
        The bytes of `bill_of_materials`.

    Raises:
        UserError: If the evaluation is not such an object.
    """
    facts = dict(training or {})
    measured = _measured(evaluation)
    data = [*_rows(facts.get("data"), "data"), *_rows(facts.get("inputs"), "inputs")]
    rows = [(key, str(value)) for key, value in _details(policy, facts) if value != BLANK]
    rows += [(f"procedure.{key}", value) for key, value in _rows(dict(policy.provenance), "")]
    return bill_of_materials(
        name,
        importlib.metadata.version("socialiq"),
        file_sha256=file_sha256,
        architecture=f"network {_network(policy)}",
        inputs=f"{policy.n_features} numbers, float32",
        outputs=_outputs(policy),
        data=dict(data),
        metrics=[Metric(one_line(key, 60), _text(value)) for key, value in measured.items()],
        properties={f"socialiq:{key}": value for key, value in rows},
    )


def trained_angle(record: Mapping[str, Any]) -> float | None:
    """Return the angle that the policy was trained for, or that a dial was set to."""
    numbers = record.get("numbers")
    angle = record.get("angle", numbers.get("angle") if isinstance(numbers, dict) else None)
    if isinstance(angle, bool) or not isinstance(angle, int | float) or not math.isfinite(angle):
        return None
    return float(angle)


def _details(policy: Exported, facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows: list[tuple[str, Any]] = [
        ("World", str(facts.get("world", "")) or None),
        ("Made by", facts.get("made_by")),
        ("Learner", policy.provenance.get("learner")),
        ("Input", f"{policy.n_features} numbers, float32"),
        ("The first layer reads", "; ".join(dict.fromkeys(map(_view, _networks(policy))))),
        ("Network", _network(policy)),
        ("Output", _outputs(policy)),
    ]
    if not isinstance(policy, ActorPolicy):
        rows.append(("Temperature of the soft policy", f"{policy.temperature:g}"))
    rows.append(("SHA-256 of the file's content", policy.sha256))
    rows.append(("Card written with", f"socialiq {importlib.metadata.version('socialiq')}"))
    rows += [("Versions", _text(facts["versions"]))] if facts.get("versions") else []
    return [(key, str(value) if value else Markdown(BLANK)) for key, value in rows]


def _outputs(policy: Exported) -> str:
    if isinstance(policy, ActorPolicy):
        return f"{policy.action_size} numbers in [-1, 1], the bounds of the action space"
    return f"a value of each of {policy.n_actions} actions; the best is taken"


def _network(policy: Exported) -> str:
    """Return the widths and activation of a network, or of each network of an ensemble."""
    texts = []
    members = _networks(policy)
    for network in members:
        widths = [network.weights[0].shape[1], *(len(bias) for bias in network.biases)]
        texts.append(f"{'-'.join(map(str, widths))}, {network.activation}")
    text = "; ".join(dict.fromkeys(texts))
    return text if len(members) == 1 else f"mean of the values of {len(members)}: {text}"


def _view(network: QPolicy | ActorPolicy) -> str:
    if network.view is None:
        return "the observation as it is"
    if isinstance(network.view, OneHot):
        return "one place for each value of each feature"
    how = "as a set" if network.view.choice.pooled else "side by side"
    users = "vehicles" if network.view.choice.is_of_rows else "road users along the ego's route"
    return f"{users} seen from the ego, {how}"


def _networks(policy: Exported) -> tuple[Any, ...]:
    """Return the networks of a policy; of a dial with a rule, the dial's, which reads the angle."""
    return (policy.dial.turned,) if isinstance(policy, ContextPolicy) else members_of(policy)


def _rows(value: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield nested settings as (dotted name, value), at most `MOST_ROWS`."""
    waiting = [(name, value)]
    count = 0
    while waiting and count < MOST_ROWS:
        key, entry = waiting.pop(0)
        if isinstance(entry, Mapping) and entry:
            prefix = f"{key}." if key else ""
            waiting = [(f"{prefix}{name}", inner) for name, inner in entry.items()] + waiting
        elif entry is not None and entry not in ({}, []):
            count += 1
            yield key, _text(entry)
    if waiting:
        yield "...", "more than can be listed; the file has all"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value)


def _measured(evaluation: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the names and scalars of an evaluation; `UserError` if it is nested or of several."""
    if evaluation is None:
        return {}
    if "policies" in evaluation:
        raise UserError("the evaluation is of several policies: evaluate this one alone")
    flat = all(isinstance(value, str | int | float) for value in evaluation.values())
    if not flat or not evaluation:
        raise UserError(
            "the evaluation must be one object of names and numbers: write it with "
            "socialiq evaluate POLICY --json"
        )
    return dict(evaluation)


def _front(
    name: str, angle: float | None, facts: Mapping[str, Any], measured: Mapping[str, Any]
) -> str:
    """Return YAML front matter; each value is written as JSON, which is valid YAML."""
    tags = ["reinforcement-learning", "inverse-reinforcement-learning", "driving", "socialiq"]
    entries: dict[str, Any] = {"library_name": "socialiq", "tags": tags}
    entries["pipeline_tag"] = "reinforcement-learning"
    if angle is not None:
        entries["social_angle_degrees"] = angle
    metrics = [
        {"type": one_line(key, 60), "value": value}
        for key, value in measured.items()
        if isinstance(value, int | float) and math.isfinite(value)
    ]
    if metrics:
        world = one_line(str(facts.get("world") or "unnamed world"))
        result = {
            "task": {"type": "reinforcement-learning", "name": "driving"},
            "dataset": {"name": world, "type": "simulator"},
            "metrics": metrics,
        }
        entries["model-index"] = [{"name": one_line(name), "results": [result]}]
    lines = [f"{key}: {json.dumps(value)}" for key, value in entries.items()]
    return "\n".join([*lines, "# license: [ blank ]"])


@dataclass(frozen=True)
class Metric:
    """A measured number, with its interval if there is one."""

    type: str
    value: str
    low: str | None = None
    high: str | None = None

    def as_json(self) -> dict[str, Any]:
        """Return it as a `performanceMetric`."""
        metric: dict[str, Any] = {"type": self.type, "value": self.value}
        if self.low is not None and self.high is not None:
            metric["confidenceInterval"] = {"lowerBound": self.low, "upperBound": self.high}
        return metric


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
    """Return a bill of materials of one policy, of the facts that are known.

    What is empty or None is left out.

    Args:
        name: Name of the policy.
        version: Version of socialiq.
        file_sha256: SHA-256 of the policy's file, if it has one.
        architecture: Its network, in words.
        inputs: Form of its observations, in words.
        outputs: Form of its actions, in words.
        data: Facts about its training data, by name.
        metrics: Measured numbers.
        limits: Technical limits, each a sentence.
        properties: Further facts by name; this package's names begin with "socialiq:".

    Returns:
        A JSON object as indented text with a newline at its end. Equal arguments give equal bytes.
    """
    parameters: dict[str, Any] = {"task": "choose the action for an observation"}
    parameters |= {"modelArchitecture": architecture} if architecture else {}
    if data:
        dataset = {"type": "dataset", "name": "training data"}
        parameters["datasets"] = [dataset | {"contents": {"properties": _properties(data)}}]
    parameters |= {"inputs": [{"format": inputs}]} if inputs else {}
    parameters |= {"outputs": [{"format": outputs}]} if outputs else {}
    card: dict[str, Any] = {"modelParameters": parameters}
    if metrics:
        rows = [metric.as_json() for metric in metrics]
        card["quantitativeAnalysis"] = {"performanceMetrics": rows}
    if limits:
        card["considerations"] = {"technicalLimitations": list(limits)}
    component: dict[str, Any] = {"bom-ref": "policy", "type": "machine-learning-model"}
    component |= {"name": name, "modelCard": card}
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
    # A name; not an address.
    space = uuid.uuid5(uuid.NAMESPACE_URL, "https://socialiq.example/bill-of-materials/1")
    content["serialNumber"] = f"urn:uuid:{uuid.uuid5(space, text)}"
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()


def _properties(facts: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"name": name, "value": value} for name, value in facts.items()]

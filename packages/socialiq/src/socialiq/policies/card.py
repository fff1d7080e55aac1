"""Model cards: the recorded facts about a policy, and visible blanks where nothing is recorded.

Markdown with YAML front matter, as model hubs read it. User-provided names are escaped, so that
they cannot change the card's structure.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import Markdown, one_line, templates
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy, members_of
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import OneHot
from socialiq.policies.bill_of_materials import Metric, bill_of_materials
from socialiq.policies.interface import Interface
from socialiq.worlds.context_policy import ContextPolicy

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
    """Return a card in Markdown.

    Args:
        policy: The policy; its provenance has the angle and the procedure.
        name: Its name.
        training: Further records of its training: the content of `run.json`, or its entry in the
            atlas' manifest. Only `data`, `inputs`, `world`, `versions`, `made_by` and `options`
            count.
        evaluation: One flat object of names and numbers, as `socialiq evaluate --json` prints it.
        evaluated_by: Origin of the evaluation, in words.

    Raises:
        UserError: If the evaluation is not such an object.
    """
    known, measured = dict(training or {}), _measured(evaluation)
    record = dict(policy.provenance)
    angle = trained_angle(record)
    return (
        templates("socialiq.policies", most=200)
        .get_template("card.md.j2")
        .render(
            front=Markdown(_front(name, angle, known, measured)),
            name=name,
            policy=policy,
            chosen=_chosen(policy),
            angle=angle,
            blank=Markdown(BLANK),
            details=_details(policy, known),
            data=[*_rows(known.get("data"), "data"), *_rows(known.get("inputs"), "inputs")],
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
        file_sha256: SHA-256 of its file, if it has one of its own.
        training: As for `model_card`.
        evaluation: As for `model_card`.

    Raises:
        UserError: If the evaluation is not one flat object.
    """
    known, measured = dict(training or {}), _measured(evaluation)
    record = dict(policy.provenance)
    data = [*_rows(known.get("data"), "data"), *_rows(known.get("inputs"), "inputs")]
    facts = [(key, str(value)) for key, value in _details(policy, known) if value != BLANK]
    facts += [(f"procedure.{key}", value) for key, value in _rows(record, "")]
    return bill_of_materials(
        name,
        importlib.metadata.version("socialiq"),
        file_sha256=file_sha256,
        architecture=f"network {_network(policy)}",
        inputs=f"{policy.n_features} numbers, float32",
        outputs=_outputs(policy),
        data=dict(data),
        metrics=[Metric(one_line(key, 60), _text(value)) for key, value in measured.items()],
        properties={f"socialiq:{key}": value for key, value in facts},
    )


def trained_angle(record: Mapping[str, Any]) -> float | None:
    """Return the angle that the policy was trained for, or that a dial was set to."""
    numbers = record.get("numbers")
    found = record.get("angle", numbers.get("angle") if isinstance(numbers, dict) else None)
    if isinstance(found, bool) or not isinstance(found, int | float) or not math.isfinite(found):
        return None
    return float(found)


def _details(policy: Exported, known: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("World", str(known.get("world", "")) or None),
        ("Made by", known.get("made_by")),
        ("Learner", policy.provenance.get("learner")),
        ("Input", f"{policy.n_features} numbers, float32"),
        ("The first layer reads", _each(policy, _view)),
        ("Network", _network(policy)),
        ("Output", _outputs(policy)),
        *_temperature(policy),
        ("SHA-256 of the file's content", policy.sha256),
        ("Card written with", f"socialiq {importlib.metadata.version('socialiq')}"),
    ]
    rows += [("Versions", _text(known["versions"]))] if known.get("versions") else []
    return [(key, str(value) if value else Markdown(BLANK)) for key, value in rows]


def _outputs(policy: Exported) -> str:
    if isinstance(policy, ActorPolicy):
        return f"{policy.action_size} numbers in [-1, 1], the bounds of the action space"
    return f"a value of each of {policy.n_actions} actions; the best is taken"


def _chosen(policy: Exported) -> str:
    size = policy.action_size if isinstance(policy, ActorPolicy) else 0
    return Interface(policy.n_features, policy.n_actions, size).answer


def _temperature(policy: Exported) -> list[tuple[str, str | None]]:
    if isinstance(policy, ActorPolicy):
        return []
    return [("Temperature of the soft policy", f"{policy.temperature:g}")]


def _network(policy: Exported) -> str:
    """Return the widths and activation of a network, or of each network of an ensemble."""

    def one(network: QPolicy | ActorPolicy) -> str:
        widths = [network.weights[0].shape[1], *(len(bias) for bias in network.biases)]
        return f"{'-'.join(map(str, widths))}, {network.activation}"

    members = _networks(policy)
    listed = _each(policy, one)
    return listed if len(members) == 1 else f"mean of the values of {len(members)}: {listed}"


def _view(network: QPolicy | ActorPolicy) -> str:
    if network.view is None:
        return "the observation as it is"
    if isinstance(network.view, OneHot):
        return "one place for each value of each feature"
    how = "as a set" if network.view.choice.pooled else "side by side"
    return f"vehicles seen from the ego, {how}"


def _each(policy: Exported, describe: Callable[[Any], str]) -> str:
    """Return the descriptions of a policy's networks, each once."""
    return "; ".join(dict.fromkeys(describe(one) for one in _networks(policy)))


def _networks(policy: Exported) -> tuple[Any, ...]:
    """Return the networks of a policy; of a dial with a rule, the dial's, which reads the angle."""
    return (policy.dial.turned,) if isinstance(policy, ContextPolicy) else members_of(policy)


def _rows(value: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield nested settings as (dotted name, value), at most `MOST_ROWS`."""
    waiting, listed = [(name, value)], 0
    while waiting and listed < MOST_ROWS:
        key, one = waiting.pop(0)
        if isinstance(one, Mapping) and one:
            inner = [(f"{key}.{part}" if key else str(part), sub) for part, sub in one.items()]
            waiting = inner + waiting
        elif one is not None and one not in ({}, []):
            listed += 1
            yield key, _text(one)
    if waiting:
        yield "...", "more than can be listed; the file has all"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value)


def _measured(evaluation: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the names and scalars of an evaluation.

    Raises:
        UserError: If it is of several policies, or nested.
    """
    if evaluation is None:
        return {}
    if "policies" in evaluation:
        raise UserError("the evaluation is of several policies: evaluate this one alone")
    nested = [key for key, one in evaluation.items() if not isinstance(one, str | int | float)]
    if nested or not evaluation:
        raise UserError(
            "the evaluation must be one object of names and numbers: write it with "
            "socialiq evaluate POLICY --json"
        )
    return dict(evaluation)


def _front(
    name: str, angle: float | None, known: Mapping[str, Any], measured: Mapping[str, Any]
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
        world = one_line(str(known.get("world") or "unnamed world"))
        result = {
            "task": {"type": "reinforcement-learning", "name": "driving"},
            "dataset": {"name": world, "type": "simulator"},
            "metrics": metrics,
        }
        entries["model-index"] = [{"name": one_line(name), "results": [result]}]
    lines = [f"{key}: {json.dumps(value)}" for key, value in entries.items()]
    return "\n".join([*lines, "# license: [ blank ]"])

"""`evaluate --data`: J(α) of policies from episodes that others drove, without an environment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli.output import print_json, print_table, say
from socialiq.demonstrations import files
from socialiq.errors import UserError
from socialiq.evaluation.logged import Chances, Logged
from socialiq.evaluation.off_policy import Estimate, Evaluator, OffPolicy
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import ValuePolicy
from socialiq.policies.load import load_policy
from socialiq.storage import kind_of
from socialiq.types import Policy, Row

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Angles in degrees at which a policy is evaluated; a dial is turned to each in its range."""


def evaluate_data(
    policies: Sequence[str], data: Path, *, soft: bool, seed: int, allow_code: bool, json: bool
) -> None:
    """Evaluate and print; what the data can't support is said on standard error.

    Args:
        policies: Policy files, or python:MODULE:ATTRIBUTE.
        data: Demonstrations file.
        soft: Whether policies draw from softmax(Q/τ).
        seed: Seed of the bootstrap.
        allow_code: Whether a Python module may be imported.
        json: Whether to print one JSON object.

    Raises:
        UserError: If data and policies don't fit together.
    """
    logged = Logged.of(files.load(data))
    evaluator = Evaluator(logged, resamples=200, seed=seed)
    estimates = {
        spec: list(_rows(evaluator, spec, soft=soft, allow_code=allow_code)) for spec in policies
    }
    warnings = [
        f"{spec}{where}: {line}" for spec, rows in estimates.items() for where, line in _lines(rows)
    ]
    if json:
        described = {"data": str(data), "episodes": logged.data.n_episodes, "seed": seed}
        results = [{"policy": spec, "angles": rows} for spec, rows in estimates.items()]
        print_json(described | {"policies": results})
    else:
        for spec, rows in estimates.items():
            columns = [{name: row[name] for name in row if name != "warning"} for row in rows]
            print_table(columns, f"{spec}: J(α) from {logged.data.n_episodes} episodes of {data}")
        for line in warnings:
            say(line)


def _rows(evaluator: Evaluator, spec: str, *, soft: bool, allow_code: bool) -> Iterator[Row]:
    """Yield a row for each angle; a policy of one angle is evaluated once."""
    data = evaluator.logged.data
    turned = kind_of(Path(spec)) == "dial"
    angles = ANGLES
    if turned:
        dial = DialPolicy.load(Path(spec))
        angles = tuple(angle for angle in ANGLES if dial.low <= angle <= dial.high)
        if not angles:
            raise UserError(f"{spec} has none of {ANGLES}: `socialiq turn` it to one angle first")
    estimate: OffPolicy | None = None
    for angle in angles:
        if estimate is None or turned:
            with _loaded(spec, data.n_features, data.n_actions, angle, allow_code) as policy:
                estimate = evaluator.evaluate(chances_of(policy, data.n_actions, soft=soft))
        yield _row(estimate, angle)


@contextmanager
def _loaded(
    spec: str, n_features: int, n_actions: int, angle: float, allow_code: bool
) -> Iterator[Policy]:
    with load_policy(spec, n_features, n_actions, angle=angle, allow_code=allow_code) as loaded:
        yield loaded.policy


def chances_of(policy: Policy, n_actions: int, *, soft: bool) -> Chances:
    """Return a policy's action probabilities as a function of observations.

    Args:
        policy: A network of ours, or anything with `predict`, which is then deterministic.
        n_actions: Number of actions.
        soft: Whether a network of ours draws from softmax(Q/τ).

    Raises:
        UserError: If another policy than ours is to be soft: it tells no probabilities.
    """
    if isinstance(policy, ValuePolicy):
        if soft:
            return policy.probabilities
        return lambda seen: np.eye(n_actions)[policy.q_values(seen).argmax(axis=1)]
    if soft:
        raise UserError(
            "--soft needs probabilities, which only our own policies tell: leave it out"
        )

    def chosen(observations: np.ndarray) -> np.ndarray:
        actions = [int(np.ravel(policy.predict(row)[0])[0]) for row in observations]
        return np.eye(n_actions)[actions]

    return chosen


def _row(found: OffPolicy, angle: float) -> Row:
    """Return both estimates at an angle; empty cells for what has nothing to stand on."""
    row: Row = {"angle": angle}
    row |= _cells("fitted_q", found.fitted, angle, shown=True)
    row |= _cells("importance", found.whole, angle, shown=found.weighted_supported)
    return row | {
        "effective_episodes": found.effective,
        "not_shown": found.left,
        "warning": found.warning,
    }


def _cells(name: str, estimate: Estimate, angle: float, *, shown: bool) -> dict[str, Any]:
    values = estimate.value(angle) if shown else (math.nan,) * 3
    columns = (name, f"{name}_low", f"{name}_high")
    return {
        column: value if math.isfinite(value) else ""
        for column, value in zip(columns, values, strict=True)
    }


def _lines(rows: Sequence[Row]) -> Iterator[tuple[str, str]]:
    """Yield each warning once, with the angles that it is about."""
    by_line: dict[str, list[str]] = {}
    for row in rows:
        if row["warning"]:
            by_line.setdefault(str(row["warning"]), []).append(f"{row['angle']:g}")
    for line, angles in by_line.items():
        yield (f", {', '.join(angles)} degrees" if len(angles) < len(rows) else ""), line

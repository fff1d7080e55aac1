"""`evaluate --data`: J(α) of policies from episodes that others drove, without an environment."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli.drivers import complain_if_it_stands, dial_of
from socialiq.cli.output import print_json, print_table, say
from socialiq.demonstrations import files
from socialiq.errors import UserError
from socialiq.evaluation.off_policy import Chances, Estimate, Evaluator, Logged
from socialiq.nn.q_policy import ValuePolicy
from socialiq.policies.load import load_policy
from socialiq.types import Policy, Row

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Angles in degrees at which a policy is evaluated; a dial is turned to each in its range."""


def evaluate_data(command: Any, policies: Sequence[str], data: Path) -> int:
    """Evaluate policies on a file of demonstrations, and print.

    The command has `soft` (whether policies draw from softmax(Q/τ)), `seed` (of the bootstrap),
    `allow_code` and `json`. What the data can't support is said on standard error.
    """
    logged = Logged.of(files.load(data))
    evaluator = Evaluator(logged, resamples=200, seed=command.seed)
    estimates = {spec: _rows(evaluator, spec, command) for spec in policies}
    if command.json:
        described = {"data": str(data), "episodes": logged.data.n_episodes, "seed": command.seed}
        results = [{"policy": spec, "angles": rows} for spec, rows in estimates.items()]
        print_json(described | {"policies": results})
        return 0
    for spec, rows in estimates.items():
        columns = [{name: row[name] for name in row if name != "warning"} for row in rows]
        print_table(columns, f"{spec}: J(α) from {logged.data.n_episodes} episodes of {data}")
    for spec, rows in estimates.items():
        by_line: dict[str, list[str]] = {}
        for row in rows:
            by_line.setdefault(row["warning"], []).append(f"{row['angle']:g}")
        for line, angles in by_line.items():
            where = f", {', '.join(angles)} degrees" if len(angles) < len(rows) else ""
            if line:
                say(f"{spec}{where}: {line}")
    return 0


def _rows(evaluator: Evaluator, spec: str, command: Any) -> list[Row]:
    """Return both estimates at each angle; a policy of one angle is evaluated once."""
    data, code = evaluator.logged.data, command.allow_code
    dial, angles = dial_of(spec), ANGLES
    if dial is not None:
        complain_if_it_stands(spec, dial, data.observation)
        angles = tuple(angle for angle in ANGLES if dial.low <= angle <= dial.high)
        if not angles:
            raise UserError(f"{spec} has none of {ANGLES}: `socialiq turn` it to one angle first")
    rows, estimate = [], None
    for angle in angles:
        if estimate is None or dial is not None:
            loaded = load_policy(
                spec, data.n_features, data.n_actions, angle=angle, allow_code=code
            )
            with loaded:
                chances = _chances_of(loaded.policy, data.n_actions, command.soft)
                estimate = evaluator.evaluate(chances)
        row: Row = {"angle": angle}
        row |= _cells("fitted_q", estimate.fitted, angle, filled=True)
        row |= _cells("importance", estimate.whole, angle, filled=estimate.weighted_supported)
        row |= {"effective_episodes": estimate.effective, "not_shown": estimate.left}
        rows.append(row | {"warning": estimate.warning})
    return rows


def _chances_of(policy: Policy, n_actions: int, soft: bool) -> Chances:
    """Return a policy's action probabilities; anything but a network of ours is deterministic."""
    if isinstance(policy, ValuePolicy):
        if soft:
            return policy.probabilities
        return lambda states: np.eye(n_actions)[policy.q_values(states).argmax(axis=1)]
    if soft:
        raise UserError(
            "--soft needs probabilities, which only our own policies tell: leave it out"
        )

    def chosen(observations: np.ndarray) -> np.ndarray:
        actions = [int(np.ravel(policy.predict(row)[0])[0]) for row in observations]
        return np.eye(n_actions)[actions]

    return chosen


def _cells(name: str, estimate: Estimate, angle: float, *, filled: bool) -> dict[str, Any]:
    """Return an estimate with its interval; empty cells for what has nothing to stand on."""
    values = estimate.value(angle) if filled else (math.nan,) * 3
    columns = (name, f"{name}_low", f"{name}_high")
    return {
        column: value if math.isfinite(value) else ""
        for column, value in zip(columns, values, strict=True)
    }

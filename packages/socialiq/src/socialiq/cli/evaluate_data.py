"""`evaluate --data`: J(α) of policies from episodes that others drove, without an environment."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli.drivers import complain_if_it_stands, dial_of
from socialiq.cli.output import Result, print_table, say
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.off_policy import Chances, Estimate, Evaluator, Logged
from socialiq.nn.q_policy import ValuePolicy
from socialiq.policies.load import load_policy, name_of
from socialiq.types import Policy, Row

ANGLES = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
"""Angles in degrees at which a policy is evaluated without --angle; a dial is turned to each in its
range."""


def evaluate_data(command: Any, policies: Sequence[Any], data: Path | Demonstrations) -> Result:
    """Evaluate policies on demonstrations.

    Args:
        command: Object with `angle` in degrees (None for `ANGLES`), `soft` (whether policies draw
            from softmax(Q/τ)), `seed` (of the bootstrap) and `allow_code`.
        policies: Policies as for `load_policy`, or dials.
        data: Demonstrations, or their file.

    Returns:
        The estimates of each policy at each angle, with a warning about what the data can't
        support.

    Raises:
        UserError: If the file or a policy can't be read, or a dial has none of `ANGLES`.
    """
    logged = Logged.of(files.load(data) if isinstance(data, Path) else data)
    evaluator = Evaluator(logged, resamples=200, seed=command.seed)
    fitted: dict[tuple[str, float], Estimate] = {}
    estimates = {name_of(spec): _rows(evaluator, spec, command, fitted) for spec in policies}
    if len(estimates) > 1:
        _compare(estimates, fitted)
    name = str(data) if isinstance(data, Path) else files.sha256_of(data)
    described = {"data": name, "episodes": logged.data.n_episodes, "seed": command.seed}
    results = [{"policy": name, "angles": rows} for name, rows in estimates.items()]
    table = [{"policy": name} | row for name, rows in estimates.items() for row in rows]
    numbers = described | {"policies": results}
    return Result(numbers, table, table=table, labels=("policy", "angle"))


def print_estimates(result: Mapping[str, Any]) -> None:
    """Print a table for each policy, and on standard error what the data can't support."""
    estimates = {policy["policy"]: policy["angles"] for policy in result["policies"]}
    for spec, rows in estimates.items():
        columns = [{name: row[name] for name in row if name != "warning"} for row in rows]
        print_table(columns, f"{spec}: J(α) from {result['episodes']} episodes of {result['data']}")
    for spec, rows in estimates.items():
        by_line: dict[str, list[str]] = {}
        for row in rows:
            by_line.setdefault(row["warning"], []).append(f"{row['angle']:g}")
        for line, angles in by_line.items():
            where = f", {', '.join(angles)} degrees" if len(angles) < len(rows) else ""
            if line:
                say(f"{spec}{where}: {line}")


def _compare(
    estimates: Mapping[str, list[Row]], fitted: Mapping[tuple[str, float], Estimate]
) -> None:
    """Add to the rows of each angle by how much the best policy exceeds theirs, and which it is."""
    for angle in {angle for _, angle in fitted}:
        of_angle = {name: fitted[name, angle] for name in estimates if (name, angle) in fitted}
        best = max(of_angle, key=lambda name: of_angle[name].value(angle)[0])
        for name, estimate in of_angle.items():
            row = next(row for row in estimates[name] if row["angle"] == angle)
            row |= _cells("below_best", of_angle[best].less(estimate), angle, filled=True)
            row |= {"best": name == best, "warning": row.pop("warning")}


def _rows(
    evaluator: Evaluator, spec: Any, command: Any, fitted: dict[tuple[str, float], Estimate]
) -> list[Row]:
    """Return both estimates at each angle; a policy of one angle is evaluated once.

    Args:
        evaluator: Evaluator of the data.
        spec: The policy.
        command: As for `evaluate_data`.
        fitted: Gets the estimates by fitted Q evaluation, by policy and angle.
    """
    data = evaluator.logged.data
    code = command.allow_code
    dial = dial_of(spec)
    angles = ANGLES if command.angle is None else (command.angle,)
    if dial is not None:
        complain_if_it_stands(spec, dial, data.observation)
        within = tuple(angle for angle in angles if dial.low <= angle <= dial.high)
        if not within:
            raise UserError(
                f"{name_of(spec)} has none of {angles}: `socialiq turn` it to one angle first"
            )
        angles = within
    rows = []
    estimate = None
    for angle in angles:
        if estimate is None or dial is not None:
            sizes = data.n_features, data.n_actions
            schema = data.schema
            loaded = load_policy(spec, *sizes, angle=angle, allow_code=code, schema=schema)
            with loaded:
                chances = chances_of(loaded.policy, data.n_actions, command.soft)
                estimate = evaluator.evaluate(chances)
        fitted[name_of(spec), angle] = estimate.fitted
        row: Row = {"angle": angle}
        row |= _cells("fitted_q", estimate.fitted, angle, filled=True)
        row |= _cells("importance", estimate.whole, angle, filled=estimate.weighted_supported)
        row |= {"effective_episodes": estimate.effective, "not_shown": estimate.left}
        rows.append(row | {"warning": estimate.warning})
    return rows


def chances_of(policy: Policy, n_actions: int, soft: bool = False) -> Chances:
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
    """Return an estimate with its interval; cells are empty where an estimate has no support."""
    values = estimate.value(angle) if filled else (math.nan,) * 3
    columns = (name, f"{name}_low", f"{name}_high")
    return {
        column: value if math.isfinite(value) else ""
        for column, value in zip(columns, values, strict=True)
    }

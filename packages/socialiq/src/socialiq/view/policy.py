"""A policy in the page: the page steps the compiled core, and asks here for each decision."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.audit.request import Trust, resolve_policy
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.interface import Loaded
from socialiq.types import Policy
from socialiq.view import View
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

MOST_ROWS = 64
"""Largest number of observations in one question of the page."""


class PolicyDecider:
    """Decisions of one policy, or of a dial at the angle that the page asks for.

    Arguments are those of `policy_view`.

    Raises:
        UserError: If it can't be read, or is made for another world.
    """

    def __init__(self, spec: str, angle: float, trust: Trust) -> None:
        self._spec, self._trust = spec, trust
        self._world = Intersection(Options())
        self._open = contextlib.ExitStack()
        self._angle = angle
        self.loaded = self._load(angle)
        self._policies: dict[float, Policy] = {angle: self.loaded.policy}
        self.close = self._open.close

    @property
    def turns(self) -> bool:
        """Whether the policy is a dial."""
        return self.loaded.record.kind == "dial"

    def decide(self, question: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the `actions` of some observations, one for each.

        Args:
            question: `observations`, rows of the world's features; `decisions`, how many each
                episode has had; and `angle` in degrees, of a dial.

        Raises:
            UserError: If the question is malformed, the policy fails, or has no such angle.
        """
        n_features = self._world.n_features
        unknown = UserError("the page asked in a way that is not known: reload it")
        try:
            observations = np.array(question["observations"], np.float32)
            times = np.array(question["decisions"], np.float32)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise unknown from error
        rows = len(observations) if observations.ndim == 2 else 0
        fits = 1 <= rows <= MOST_ROWS and times.shape == (rows,)
        if not fits or observations.shape[1] != n_features or not np.isfinite(observations).all():
            raise unknown
        if self.loaded.record.interface.n_features == n_features + 1:
            observations = np.column_stack([observations, times])
        angle, degrees = question.get("angle"), self._angle
        if self.turns and angle is not None:
            if not isinstance(angle, int | float) or not 0 <= angle < 360:
                raise UserError("the page asked for no angle: reload it")
            degrees = float(angle)
        if degrees not in self._policies:
            if len(self._policies) > 360:
                raise UserError("the page asked for too many angles: reload it")
            self._policies[degrees] = self._load(degrees).policy
        chosen, _ = self._policies[degrees].predict(observations, deterministic=True)
        return {"actions": np.asarray(chosen).astype(int).tolist()}

    def _load(self, angle: float) -> Loaded:
        return self._open.enter_context(resolve_policy(self._spec, self._world, angle, self._trust))


def policy_view(spec: str, angle: float, trust: Trust) -> View:
    """Return a policy as content of the page.

    Args:
        spec: Policy, as `resolve_policy` takes it.
        angle: Angle of a dial at the start, degrees.
        trust: Permissions of a policy that is code.

    Raises:
        UserError: If it can't be read, or is made for another world.
    """
    decider = PolicyDecider(spec, angle, trust)
    record = decider.loaded.record
    name = one_line(spec if ":" in spec else Path(spec).name, 60)
    data: dict[str, Any] = {"name": name, "policy": record.kind, "sha256": record.sha256}
    if decider.turns:
        dial = DialPolicy.load(Path(spec))
        data |= {"dial": {"angle": angle, "low": dial.low, "high": dial.high}}
    return View(
        kind="policy",
        title=name,
        lead="Your policy on the same seeds as the dial of the package. It decides in Python, the "
        "traffic runs in this page.",
        data=data,
        decide=decider.decide,
        close=decider.close,
    )

"""Policy of a dial whose angle follows a rule: a function of the observation, not a number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int64

from socialiq.errors import UserError
from socialiq.nn.dial_policy import DialPolicy, check_in_range
from socialiq.nn.ensemble import load_values
from socialiq.nn.q_policy import ValuePolicy, checked_batch
from socialiq.nn.saved import Arrays, Header
from socialiq.social.angle_rule import AngleRule
from socialiq.storage import kind_of
from socialiq.worlds.situation import angles_of, check_rule, plain_features


@dataclass(frozen=True)
class ContextPolicy(ValuePolicy):
    """Policy that acts at each observation as the dial does at the rule's angle there.

    It decides as if the angle stayed as it is now; it doesn't foresee that the situation, and with
    it the angle, will change (`evaluation.context`).

    Attributes:
        dial: The dial.
        rule: The rule.
        rng: Generator of the stochastic policy's draws.
        sha256: SHA-256 of the file's content, for a policy that was loaded.
    """

    KIND = "context-policy"

    dial: DialPolicy
    rule: AngleRule
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    sha256: str = ""

    @classmethod
    def of(cls, dial: DialPolicy, rule: AngleRule) -> ContextPolicy:
        """Join a dial and a rule.

        Raises:
            UserError: If the rule reads an unknown feature, the dial is of another world, or an
                angle is outside the dial's range.
        """
        policy = cls(dial, rule)
        check_rule(rule)
        plain = plain_features(rule.world)
        if dial.n_features not in (plain, plain + 1):
            raise UserError(
                f"the dial takes {dial.n_features} features, {rule.world} has {plain} (one more "
                "with a clock): name a dial of the rule's world"
            )
        check_rule(rule, clock=policy.clock)
        for angle in rule.span:
            check_in_range(angle, dial.low, dial.high)
        return policy

    @property
    def clock(self) -> bool:
        """Whether the time is the last feature of an observation."""
        return self.dial.n_features == plain_features(self.rule.world) + 1

    @property
    def temperature(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """τ of the stochastic policy softmax(Q/τ), the dial's."""
        return self.dial.turned.temperature

    @property
    def provenance(self) -> Mapping[str, Any]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """JSON-compatible record of how the policy was made."""
        return {**self.dial.provenance, "rule": self.rule.as_json()}

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.dial.n_features

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.dial.n_actions

    def angles(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> tuple[Float64[np.ndarray, " batch"], Int64[np.ndarray, " batch"]]:
        """Return the rule's angle in degrees, and the number of the context, of each observation.

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        batch = checked_batch(observations, self.n_features)
        if self.clock:
            return angles_of(self.rule, batch[:, :-1], batch[:, -1])
        return angles_of(self.rule, batch)

    def q_values(
        self, observations: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch action"]:
        """Return the dial's Q of each observation and action at the rule's angle.

        Raises:
            UserError: If an observation has another length or is not finite.
        """
        return self.dial.q_values_at(observations, self.angles(observations)[0])

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the file: the dial's, and the rule."""
        arrays, header = self.dial.content()
        return arrays, header | {"rule": self.rule.as_json()}

    @classmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> ContextPolicy:
        """Build a policy from a file's content, as `Saved.checked`."""
        dial = DialPolicy.checked(path, arrays, header)
        try:
            policy = cls.of(dial, AngleRule.of(header.get("rule")))
        except UserError as error:
            raise UserError(f"{path}: {error}") from error
        return replace(policy, sha256=str(header["sha256"]))


def load_driver(path: Path) -> ValuePolicy:
    """Read a file of one network, of an ensemble, or of a dial with a rule.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    is_by_rule = kind_of(path) == ContextPolicy.KIND
    return ContextPolicy.load(path) if is_by_rule else load_values(path)

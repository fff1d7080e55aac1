"""Brake for people, whatever a policy wants, in every world that knows the seconds to them."""

from __future__ import annotations

import math
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool

from socialiq.errors import UserError
from socialiq.evaluation.simulate import Watched
from socialiq.types import Policy


@runtime_checkable
class Braking(Protocol):
    """Episodes that know who moves into the way of their egos, and how an ego brakes."""

    @property
    def walks(self) -> Any:
        """True value where people walk or ride."""

    def near(self, seconds: float) -> Bool[np.ndarray, " row"]:
        """Return whether each ego reaches a person within some seconds.

        The person is in the ego's lane or moves towards it. The time is that of the ego's way at
        its speed, or at the lowest speed above 0 if it drives slower: it must not start before a
        person.

        Args:
            seconds: Time, s.
        """
        ...

    def braked(self, actions: np.ndarray) -> np.ndarray:
        """Return the actions that brake most, in the place of others.

        Args:
            actions: Numbers, or continuous actions, whose steering is kept.
        """
        ...


class Shield(Watched):
    """A policy that brakes where an ego of its batch is `near` a person.

    The state of the batch that it drives is read, so a policy that observes the vehicles alone can
    be shielded.

    Raises:
        UserError: If the world has no seconds to a person, no person walks in it, it has several
            agents, or the threshold is not positive.
    """

    def __init__(self, policy: Policy, batch: Any, seconds: float) -> None:
        if not isinstance(batch, Braking):
            raise UserError("a shield needs the seconds to a person, which this world doesn't tell")
        if not batch.walks:
            raise UserError(
                "a shield is for people on foot, and no one walks here: choose crosswalks"
            )
        if len(getattr(batch, "shape", (1,))) > 1:
            raise UserError("a shield brakes one ego: leave agents out")
        if not 0.0 < seconds < math.inf:
            raise UserError(f"a shield needs a positive number of seconds, got {seconds:g}")
        super().__init__(policy, lambda _rows: batch.near(seconds))
        self._batch = batch

    def _instead(self, observation: np.ndarray, actions: np.ndarray) -> np.ndarray:  # noqa: ARG002  the state is read
        return self._batch.braked(actions)


def shielded(policy: Policy, batch: Any, seconds: float) -> Policy:
    """Return a policy with a shield in its batch.

    Args:
        policy: The policy.
        batch: Episodes that it drives, or the environment of one episode.
        seconds: Time to collision with a person below which the ego brakes, s; for 0 the policy is
            returned as it is.
    """
    return Shield(policy, batch, seconds) if seconds else policy

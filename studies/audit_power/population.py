"""Simulated drivers with known true values, to measure the reliability of an audit's numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.verdict.calibration import preimage
from socialiq.social.angle import angle_of, exact_weights
from socialiq.types import Ending
from socialiq.worlds.highway.state import Contact

ANGLES = np.array([0.0, 30.0, 60.0, 90.0])
"""Target angles of the references in degrees."""
ACHIEVED = np.array([-20.0, 5.0, 60.0, 130.0])
"""Their true α̂ in degrees, which differs from the target angle."""
_LENGTH = 4.0  # of the references' true mean totals
_COMMON = 1.5  # standard deviation of an episode's effect on all drivers
_OWN = 1.0  # of its effect on each driver; exponential in r_env: losses are rare and large


@dataclass(frozen=True)
class Truth:
    """A population of drivers.

    Attributes:
        declared: Declared angle of the policy in degrees.
        regret: Its true regret at this angle, in reward per episode.
        at_fault: Its true share of at-fault collisions.
        struck: True share of collisions that others caused.
        arrival: True share of arrivals; the remaining episodes run out of time.
        alpha_hat: True α̂ of the policy in degrees.
    """

    declared: float = 45.0
    regret: float = 0.25
    at_fault: float = 0.05
    struck: float = 0.05
    arrival: float = 0.85
    alpha_hat: float = 30.0

    @property
    def references(self) -> Float[np.ndarray, "reference 2"]:
        """True mean totals of the references."""
        return _LENGTH * _directions(ACHIEVED)

    @property
    def policy(self) -> Float[np.ndarray, " 2"]:
        """True mean totals of the policy, in its direction and of its regret."""
        weights = np.array(exact_weights(self.declared))
        along = _directions(np.array([self.alpha_hat]))[0]
        best = float((self.references @ weights).max())
        return (best - self.regret) / float(weights @ along) * along

    @property
    def calibrated(self) -> float:
        """True calibrated angle, degrees."""
        return float(preimage(ANGLES, ACHIEVED[None], np.array([self.alpha_hat])).low[0])

    @property
    def timeout(self) -> float:
        """True share of timeouts."""
        return 1.0 - self.at_fault - self.struck - self.arrival


def draw_evidence(truth: Truth, episodes: int, seed: int) -> Evidence:
    """Draw the evidence of an audit.

    Args:
        truth: True values of the population.
        episodes: Number of episodes.
        seed: Seed of all draws.
    """
    rng = np.random.default_rng(seed)
    means = np.concatenate([truth.references, truth.policy[None]])
    common = rng.normal(0.0, _COMMON, (episodes, 2))
    totals = []
    for mean in means:
        losses = 1.0 - rng.exponential(1.0, episodes)
        own = np.stack([losses, rng.normal(size=episodes)], axis=1)
        totals.append(mean + common + _OWN * own)
    names = [f"made for {angle:g}" for angle in ANGLES]
    references = [
        _outcomes(name, total, np.full(episodes, Ending.ARRIVAL), angles=(angle,))
        for name, total, angle in zip(names, totals, ANGLES.tolist(), strict=False)
    ]
    bounds = np.cumsum([truth.at_fault, truth.struck, truth.arrival])
    kind = np.searchsorted(bounds, rng.random(episodes), side="right")
    ending = np.array([Ending.COLLISION, Ending.COLLISION, Ending.ARRIVAL, Ending.TIMEOUT])[kind]
    contact = np.array([Contact.EGO_STRUCK, Contact.EGO_WAS_STRUCK, Contact.NONE, Contact.NONE])
    return Evidence(
        scenario=f"made up: α̂ {angle_of(*truth.policy.tolist()):g} degrees",
        seeds=np.arange(episodes),
        policy=_outcomes("policy", totals[-1], ending, contact[kind]),
        references=tuple(references),
        strata={},
    )


def _outcomes(
    name: str,
    totals: np.ndarray,
    ending: np.ndarray,
    contact: np.ndarray | None = None,
    angles: tuple[float, ...] = (),
) -> Outcomes:
    none = np.zeros(len(totals)) if contact is None else contact
    length = np.ones(len(totals), np.int64)
    return Outcomes(name, totals, ending.astype(np.int8), none.astype(np.int8), length, angles)


def _directions(angles: Float[np.ndarray, " angle"]) -> Float[np.ndarray, "angle 2"]:
    radians = np.deg2rad(angles)
    return np.stack([np.cos(radians), np.sin(radians)], axis=1)

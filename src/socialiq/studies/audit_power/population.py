"""Made-up drivers whose truth is known, to show what the audit's numbers are worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.verdict.calibration import preimage
from socialiq.social.angle import angle_of, exact_weights
from socialiq.types import Ending
from socialiq.worlds.intersection.state import Contact

# What the references show, for which angles they were made, and how far they get: α̂ isn't α.
SHOWN = np.array([-20.0, 5.0, 60.0, 130.0])
ANGLES = np.array([0.0, 30.0, 60.0, 90.0])
_LENGTH = 4.0
_COMMON = 1.5  # standard deviation of what an episode gives or takes everybody
_OWN = 1.0  # of what it gives or takes each driver; exponential in r_env: losses are rare and large


@dataclass(frozen=True)
class Truth:
    """A population of drivers.

    Attributes:
        declared: Angle in degrees.
        regret: True regret of the policy there, reward per episode.
        at_fault: True share of at-fault collisions of the policy.
        struck: Of collisions that others caused.
        arrival: Of arrivals; the rest runs out of time.
        shown: α̂ of the policy, degrees.
    """

    declared: float = 45.0
    regret: float = 0.25
    at_fault: float = 0.05
    struck: float = 0.05
    arrival: float = 0.85
    shown: float = 30.0

    @property
    def references(self) -> Float[np.ndarray, "reference 2"]:
        """True mean totals of the references."""
        return _LENGTH * _directions(SHOWN)

    @property
    def policy(self) -> Float[np.ndarray, " 2"]:
        """True mean totals of the policy: as far along its own direction as leaves the regret."""
        weights = np.array(exact_weights(self.declared))
        along = _directions(np.array([self.shown]))[0]
        best = float((self.references @ weights).max())
        return (best - self.regret) / float(weights @ along) * along

    @property
    def calibrated(self) -> float:
        """True calibrated angle, degrees."""
        found = preimage(ANGLES, SHOWN[None], np.array([self.shown]))
        return float(found.low[0])

    @property
    def timeout(self) -> float:
        """True share of timeouts."""
        return 1.0 - self.at_fault - self.struck - self.arrival


def drawn(truth: Truth, episodes: int, seed: int) -> Evidence:
    """Draw the evidence of an audit.

    Args:
        truth: Of whom.
        episodes: How many.
        seed: Of everything.
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

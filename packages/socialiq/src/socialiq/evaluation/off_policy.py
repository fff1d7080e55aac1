"""Off-policy evaluation: returns of a policy from episodes that others drove.

Both estimates of a policy with intervals, and whether the episodes can support them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import t

from socialiq.errors import UserError
from socialiq.evaluation import fitted_q, logged
from socialiq.evaluation.logged import Chances, Logged
from socialiq.social.angle import exact_weights
from socialiq.statistics.bootstrap import resample_rows

LEAST_EPISODES = 30.0
"""Effective episodes below which importance sampling is not reported: its weights are then those of
a few episodes, and a bootstrap of these few is too narrow. Chosen on development seeds of the study
off-policy, where intervals over 10 to 30 effective episodes covered the truth in half the cases."""
MOST_LEFT = 0.05
"""Share of episodes that may leave the data before fitted Q evaluation is called unsupported."""
LEAST_CHANCE = 0.01
"""Probability below which an action of clones counts as not shown, if observations don't recur."""
NETWORKS = 8
"""Resamples that get a network each, where observations don't recur."""


class Estimate(NamedTuple):
    """Sums of r_env and r_social of an episode under a policy.

    Attributes:
        totals: The estimate.
        resampled: The same for each resample of the episodes.
        guessed: Sums of the logged episodes times the share of the policy's episodes of which the
            data say nothing; None where this is none.
    """

    totals: Float[np.ndarray, " 2"]
    resampled: Float[np.ndarray, "resample 2"]
    guessed: Float[np.ndarray, "episode 2"] | None = None

    def value(self, angle: float, confidence: float = 0.95) -> tuple[float, float, float]:
        """Return J(α) with the bounds of its interval; angle in degrees.

        The interval is the percentile bootstrap's where there are many resamples, and with few
        (networks) the estimate ± t times their standard deviation. Episodes of which the data say
        nothing could be as good or as bad as any logged one: they widen it on both sides.
        """
        weights = np.array(exact_weights(angle))
        value, values = float(self.totals @ weights), self.resampled @ weights
        values = values[np.isfinite(values)]
        if len(values) < 2:
            return value, np.nan, np.nan
        if len(values) >= 100:
            low, high = np.quantile(values, [(1 - confidence) / 2, (1 + confidence) / 2])
        else:
            half = t.ppf((1 + confidence) / 2, len(values) - 1) * values.std(ddof=1)
            low, high = value - half, value + half
        unknown = 0.0 if self.guessed is None else float(np.ptp(self.guessed @ weights))
        return value, float(low) - unknown, float(high) + unknown


class OffPolicy(NamedTuple):
    """Off-policy evaluation of one policy.

    Attributes:
        weighted: By weighted importance sampling, step by step.
        whole: The same by whole episodes.
        fitted: By fitted Q evaluation.
        effective: Effective episodes of importance sampling.
        left: Share of episodes in which the policy does what the data do not show in that
            observation; where observations don't recur, share of the logged steps at which it
            would do so.
        episodes: Episodes in the data.
    """

    weighted: Estimate
    whole: Estimate
    fitted: Estimate
    effective: float
    left: float
    episodes: int

    @property
    def fitted_supported(self) -> bool:
        """Whether the policy stays within what the data show."""
        return self.left <= MOST_LEFT

    @property
    def weighted_supported(self) -> bool:
        """Whether importance sampling has episodes to stand on.

        Self-normalised weights are those of the policy *given* that it stays within the data, so
        their number alone says nothing of a policy that leaves.
        """
        return self.fitted_supported and self.effective >= LEAST_EPISODES

    @property
    def warning(self) -> str:
        """One line on what the data can't support; "" if they support both estimates."""
        overlap = f"{self.effective:.1f} of {self.episodes} episodes' worth of weight"
        if not self.fitted_supported:
            return (
                f"the data can't support an evaluation: in {self.left:.0%} of its episodes the "
                f"policy does what no episode shows ({overlap})"
            )
        if not self.weighted_supported:
            return f"importance sampling not reported: {overlap}; fitted Q evaluation stands alone"
        return ""


class Evaluator:
    """Off-policy evaluation on one set of episodes, for any number of policies.

    Args:
        episodes: The episodes.
        resamples: Bootstrap resamples of the episodes; networks have at most `NETWORKS`.
        seed: Seed of the bootstrap, and of networks.
        view: Network's view of the observation, where observations hardly recur.

    Raises:
        UserError: If there are fewer than two resamples.
    """

    def __init__(
        self, episodes: Logged, resamples: int = 500, seed: int = 0, view: str = "flat"
    ) -> None:
        if resamples < 2:
            raise UserError(f"{resamples} resamples have no spread: give 2 or more")
        self.logged, self._seed, self._view = episodes, seed, view
        count = episodes.data.n_episodes
        numbers = np.concatenate(list(resample_rows(count, resamples, seed)))
        plain = np.ones((1, count))
        self._counts = np.concatenate(
            [plain, [np.bincount(row, minlength=count) for row in numbers]]
        )
        self._behaviour = (
            logged.by_counts(episodes)
            if episodes.tabular
            else logged.by_clones(episodes, seed=seed, view=view)
        )
        modes = logged.shown_modes(episodes)
        driven = np.bincount(episodes.data.episode_modes, minlength=max(modes) + 1)[modes]
        self._shares = driven / count

    def evaluate(self, policy: Chances) -> OffPolicy:
        """Return both estimates of a policy.

        Args:
            policy: Its probabilities for a batch of observations.
        """
        data, counts = self.logged, self._counts
        chances = data.chances(policy)
        ratio = logged.ratios(data, chances, self._behaviour, self._shares)
        rewards = data.by_step(data.rewards, 0.0)
        fitted, left = self._fitted(chances)
        return OffPolicy(
            _estimate(logged.step_by_step(ratio, rewards, counts)),
            _estimate(logged.whole_episodes(ratio, rewards, counts)),
            _estimate(fitted)._replace(guessed=left * np.stack(data.data.totals(), axis=1)),
            logged.effective_episodes(ratio),
            left,
            data.data.n_episodes,
        )

    def _fitted(self, chances: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the sums of each resample, and how often the policy leaves the data."""
        if self.logged.tabular:
            fitted = fitted_q.tabular(self.logged, chances, self._counts)
            return fitted.totals, float(fitted.left[0])
        totals = fitted_q.by_network(self.logged, chances, self._counts[: 1 + NETWORKS])
        driven = np.einsum("m,msa->sa", self._shares, self._behaviour)
        rare = np.where(driven < LEAST_CHANCE, chances, 0.0).sum(axis=1)
        return totals, float(rare[self.logged.state].mean())


def _estimate(rows: np.ndarray) -> Estimate:
    """Return the first row as the estimate, the others as its resamples."""
    return Estimate(rows[0], rows[1:])

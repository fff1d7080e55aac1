"""Off-policy evaluation: returns of a policy from episodes that others drove.

Fitted Q evaluation (`fitted_q`) is one way; importance sampling is a second one. In the second an
episode is weighed by how much more probable its actions are for the policy than for the mixture of
demonstrators that it was drawn from:

    ρ_t = Π_{k <= t} π(a_k|s_k) / Σ_m p_m Π_{k <= t} π_m(a_k|s_k)

with p_m the share of episodes of mode m (the balance heuristic of Veach and Guibas 1995, for
policies Agarwal et al. 2017). The world's own chances cancel. Both estimates are self-normalised:

    whole episodes   Σ_i ρ_T G / Σ_i ρ_T
    step by step     Σ_t Σ_i ρ_t r_t / Σ_i ρ_t       (Precup, Sutton and Singh 2000; Thomas 2015)

Episodes of a mode are taken for draws of one policy of the observation. Probabilities that are
estimated from the same episodes give importance weights less variance than the true ones would
(Hanna, Niekum and Stone 2019).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import t

from socialiq.errors import UserError
from socialiq.evaluation import fitted_q
from socialiq.evaluation.fitted_q import Chances as Chances
from socialiq.evaluation.fitted_q import Logged as Logged
from socialiq.learners import behaviour_cloning as bc
from socialiq.social.angle import exact_weights
from socialiq.statistics.bootstrap import resample_rows
from socialiq.types import RewardPair

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
QUICK_UPDATES = 2000
"""Gradient steps of the network of an estimate without an interval."""


def by_counts(episodes: Logged) -> Float[np.ndarray, "mode state action"]:
    """Return each mode's share of each action in each distinct observation, 0 where it never was.

    Modes are those that have episodes.
    """
    data = episodes.data
    shares = []
    shape = (len(episodes.observations), data.n_actions)
    for mode in episodes.modes:
        rows = data.mode == mode
        counts = np.zeros(shape)
        np.add.at(counts, (episodes.state[rows], data.action[rows]), 1.0)
        shares.append(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0))
    return np.array(shares)


def by_clones(
    episodes: Logged, updates: int = 3000, seed: int = 0, view: str = "flat"
) -> Float[np.ndarray, "mode state action"]:
    """Return each action's probability under a clone of each mode, at each distinct observation.

    All clones are trained in one program.

    Args:
        episodes: Whole episodes.
        updates: Gradient steps of each clone.
        seed: Seed of the first clone; each further one has the next number.
        view: View of the observation, one of `nn.view.CHOICES`.
    """
    data = episodes.data
    sets = [data.select(np.flatnonzero(data.episode_modes == mode)) for mode in episodes.modes]
    static = bc.CloningConfig(hidden=(64, 64), updates=updates, batch_size=128, view=view)
    runs = [
        bc.CloningHyperparameters(learning_rate=1e-3, seed=seed + number, dataset=number)
        for number in range(len(sets))
    ]
    trained = bc.BehaviourCloning.train_on(static, runs, sets)
    clones = [trained.policy(run) for run in range(len(sets))]
    return np.array([clone.probabilities(episodes.observations) for clone in clones])


def ratios(
    episodes: Logged,
    chances: Float[np.ndarray, "state action"],
    behaviour: Float[np.ndarray, "mode state action"],
    shares: Float[np.ndarray, " mode"],
) -> Float[np.ndarray, "episode step"]:
    """Return ρ of each episode up to each step; beyond its end the last one.

    Args:
        episodes: Whole episodes.
        chances: Probabilities of the policy at each distinct observation.
        behaviour: Probabilities of each demonstrator at each distinct observation.
        shares: Share p_m of the episodes of each demonstrator; they sum to 1.
    """
    state = episodes.state
    action = episodes.data.action
    taken = chances[state, action]
    with np.errstate(divide="ignore"):
        target = np.cumsum(np.log(episodes.by_step(taken, 1.0)), axis=1)
        driven = np.stack(
            [
                np.cumsum(np.log(episodes.by_step(chance, 1.0)), axis=1)
                for chance in behaviour[:, state, action]
            ]
        )
        mixed = np.logaddexp.reduce(driven + np.log(shares)[:, None, None], axis=0)
        # An episode has a probability under its own demonstrator, so `mixed` is finite.
        return np.exp(target - mixed)


def effective_episodes(ratio: Float[np.ndarray, "episode step"]) -> float:
    """Return (Σ ρ)² / Σ ρ²: how many episodes of the policy itself the weights are worth."""
    weight = ratio[:, -1]
    squares = float(np.square(weight).sum())
    return float(weight.sum()) ** 2 / squares if squares else 0.0


class Estimate(NamedTuple):
    """Sums of r_env and r_social of an episode under a policy.

    Attributes:
        totals: The estimate.
        resampled: The same for each resample of the episodes.
        guessed: Sums of the logged episodes times the share of the policy's episodes that the data
            do not cover; None without such a share.
    """

    totals: Float[np.ndarray, " 2"]
    resampled: Float[np.ndarray, "resample 2"]
    guessed: Float[np.ndarray, "episode 2"] | None = None

    def value(self, angle: float, confidence: float = 0.95) -> tuple[float, float, float]:
        """Return J(α) with the bounds of its interval.

        The interval is the percentile bootstrap's where there are many resamples, and with few
        (networks) the estimate ± t times their standard deviation. Episodes that the data do not
        cover could be as good or as bad as any logged one: they widen it on both sides.

        Args:
            angle: The angle α in degrees.
            confidence: Probability of the interval.

        Returns:
            Estimate, low and high bound; the bounds are NaN with fewer than two finite resamples.
        """
        weights = np.array(exact_weights(angle))
        value = float(self.totals @ weights)
        values = self.resampled @ weights
        values = values[np.isfinite(values)]
        if len(values) < 2:
            return value, np.nan, np.nan
        if len(values) >= 100:
            low, high = np.quantile(values, [(1 - confidence) / 2, (1 + confidence) / 2])
        else:
            half = t.ppf((1 + confidence) / 2, len(values) - 1) * values.std(ddof=1)
            low = value - half
            high = value + half
        unknown = 0.0 if self.guessed is None else float(np.ptp(self.guessed @ weights))
        return value, float(low) - unknown, float(high) + unknown

    def less(self, lower: Estimate) -> Estimate:
        """Return the difference to another estimate, paired by resample."""
        guessed = None
        if self.guessed is not None and lower.guessed is not None:
            guessed = self.guessed + lower.guessed
        return Estimate(self.totals - lower.totals, self.resampled - lower.resampled, guessed)


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
        their number alone is no evidence for a policy that leaves.
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


def estimated(episodes: Logged, policy: Chances) -> RewardPair:
    """Return the sums of both rewards of an episode by fitted Q evaluation, without an interval.

    Args:
        episodes: The episodes.
        policy: The policy's probabilities for a batch of observations.
    """
    chances = episodes.chances(policy)
    once = np.ones((1, episodes.data.n_episodes))
    if episodes.tabular:
        return RewardPair(*fitted_q.tabular(episodes, chances, once)[0][0])
    quick = fitted_q.StaticConfig(updates=QUICK_UPDATES)
    return RewardPair(*fitted_q.by_network(episodes, chances, once, quick)[0])


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
        self.logged = episodes
        count = episodes.data.n_episodes
        numbers = np.concatenate(list(resample_rows(count, resamples, seed)))
        resampled = [np.bincount(row, minlength=count) for row in numbers]
        self._counts = np.concatenate([np.ones((1, count)), resampled])
        self._behaviour = (
            by_counts(episodes) if episodes.tabular else by_clones(episodes, seed=seed, view=view)
        )
        driven = np.bincount(episodes.data.episode_modes)[episodes.modes]
        self._shares = driven / count

    def evaluate(self, policy: Chances) -> OffPolicy:
        """Return all estimates of a policy, given its probabilities for a batch of observations."""
        episodes = self.logged
        counts = self._counts
        data = episodes.data
        chances = episodes.chances(policy)
        ratio = ratios(episodes, chances, self._behaviour, self._shares)
        rewards = episodes.by_step(episodes.rewards, 0.0)
        weighed = np.einsum("re,et,ets->rts", counts, ratio, rewards, optimize=True)
        weight = counts * ratio[:, -1]
        with np.errstate(invalid="ignore"):  # NaN without any weight
            step_by_step = (weighed / (counts @ ratio)[:, :, None]).sum(axis=1)
            by_episodes = weight @ rewards.sum(axis=1) / weight.sum(axis=1, keepdims=True)
        if episodes.tabular:
            fitted, leaves = fitted_q.tabular(episodes, chances, counts)
            left = float(leaves[0])
        else:
            fitted = fitted_q.by_network(episodes, chances, counts[: 1 + NETWORKS])
            driven = np.einsum("m,msa->sa", self._shares, self._behaviour)
            rare = np.where(driven < LEAST_CHANCE, chances, 0.0).sum(axis=1)
            left = float(rare[episodes.state].mean())
        # The first row is the estimate, the others are its resamples.
        return OffPolicy(
            Estimate(step_by_step[0], step_by_step[1:]),
            Estimate(by_episodes[0], by_episodes[1:]),
            Estimate(fitted[0], fitted[1:], guessed=left * np.stack(data.totals(), axis=1)),
            effective_episodes(ratio),
            left,
            data.n_episodes,
        )

"""Methods that use the reward pair and demonstrations, each solved exactly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import visit_counts
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.clone_dial import shares
from socialiq.learners.policy_iteration.regularised import ARBITRARY
from socialiq.learners.shared_reward.angles import Inferred, infer
from socialiq.learners.shared_reward.exact import Group, fit
from socialiq.social.angle import score, weights
from socialiq.types import Row
from studies.competence.bench import Bench

LEFT_OUT_TOLERANCE = 1e-3
"""Largest derivative of a fit that only predicts: the likelihood moves by less."""
MARGIN = 5.0  # degrees about a demonstrator's angle in which the clone is that of it alone
DISCOUNT = 0.99  # of returns-to-go, as in the thesis
C, W = 0.5, 1.0  # weights of χ² and of the prior in the thesis; the centre is wλT / (c + w)


class Inputs(NamedTuple):
    """Inputs of a method: the reward pair and one data set.

    Attributes:
        bench: World and scoring.
        seed: Seed of the data set.
        data: Episodes of each expert.
        counts: Number of times that each expert took an action at a time in a state.
    """

    bench: Bench
    seed: int
    data: list[Demonstrations]
    counts: list[np.ndarray]

    @staticmethod
    def of(bench: Bench, seed: int) -> Inputs:
        """Draw a data set and count its actions."""
        data = bench.demonstrations(seed)
        return Inputs(bench, seed, data, [visit_counts(one, bench.part) for one in data])

    @property
    def visits(self) -> list[np.ndarray]:
        """Mean counts per episode, of each expert."""
        episodes = self.bench.config.episodes_each
        return [one.sum(axis=0) / episodes for one in self.counts]

    @property
    def pooled(self) -> np.ndarray:
        """Mean counts per episode of the mixture with equal numbers of episodes."""
        return np.mean(self.visits, axis=0)

    def imitation(self) -> list[Row]:
        """Score IQ-Learn without a prior: one policy for every angle."""
        zero = np.zeros_like(self.bench.skill)
        settings = self.bench.settings._replace(shrinkage=C)
        fitted = fit(self.bench.part.mdp, [Group(1.0, self.pooled, zero)], settings)
        return self._rows("IQ-Learn, no prior", "", lambda _: fitted.correction)

    def priors(self) -> list[Row]:
        """Score the thesis' prior on returns-to-go, and the same prior on rewards."""
        rows = []
        for strength in self.bench.config.strengths:
            for method, centre in (
                ("prior on returns-to-go", self._mean_returns),
                ("prior on rewards", self.bench.reward),
            ):
                rows += self._rows(
                    method, strength, lambda a, s=strength, m=centre: self._prior(s * m(a))
                )
        return rows

    def chosen_prior(self) -> tuple[list[Row], list[Row]]:
        """Score the prior on rewards with the λ that the demonstrations choose, and say which.

        Each demonstrator is left out in turn and predicted at its own angle from the others, as an
        unseen angle would have to be. No score of the hidden skill enters.
        """
        found: list[Row] = []
        for strength in self.bench.config.candidates:
            each = [self.predicted(strength, left_out) for left_out in range(len(self.data))]
            label = {"seed": self.seed, "strength": strength}
            found.append(label | {"log_likelihood": float(np.mean(each))})
        best = max(found, key=lambda row: row["log_likelihood"])["strength"]
        for row in found:
            row["chosen"] = int(row["strength"] == best)
        rows = self._rows(
            "prior on rewards, λ by prediction",
            "",
            lambda angle: self._prior(best * self.bench.reward(angle)),
        )
        return rows, found

    def predicted(self, strength: float, left_out: int) -> float:
        """Return the log-likelihood per action of a demonstrator, learned from the others."""
        others = [visits for number, visits in enumerate(self.visits) if number != left_out]
        angle = list(MODES.values())[left_out]
        reward = self._prior(
            strength * self.bench.reward(angle), np.mean(others, axis=0), LEFT_OUT_TOLERANCE
        )
        counts = self.counts[left_out]
        chances = np.maximum(self.bench.soft(reward), 1e-300)
        return float((counts * np.log(chances)).sum() / counts.sum())

    def _prior(
        self, centre: np.ndarray, visits: np.ndarray | None = None, tolerance: float | None = None
    ) -> np.ndarray:
        """Return r̂ of IQ-Learn with a prior, as if all demonstrators had the target angle."""
        moved = W / (C + W) * centre
        settings = self.bench.settings._replace(shrinkage=C + W)
        settings = settings._replace(tolerance=tolerance or settings.tolerance)
        pooled = self.pooled if visits is None else visits
        fitted = fit(self.bench.part.mdp, [Group(1.0, pooled, moved)], settings)
        return moved + fitted.correction

    def improved_clone(self) -> tuple[list[Row], list[Row]]:
        """Score the clone of every angle, improved near it, with η by prediction; and say which η.

        As `learners.policy_iteration.regularised`, with counts for the clone and exact optima.
        Each demonstrator is left out in turn, and that η is taken whose policies take most of its
        actions. No score of the hidden skill enters.
        """
        found: list[Row] = []
        for price in self.bench.config.prices:
            each = [self.agreement(price, left_out) for left_out in range(len(self.data))]
            found.append({"seed": self.seed, "price": price, "agreement": float(np.mean(each))})
        best = max(found, key=lambda row: row["agreement"])["price"]
        for row in found:
            row["chosen"] = int(row["price"] == best)
        everyone = range(len(self.data))
        rows = self._rows(
            "improved clone, η by prediction",
            "",
            lambda angle: self._near_clone(best, angle, everyone),
        )
        return rows, found

    def agreement(self, price: float, left_out: int) -> float:
        """Return the share of a demonstrator's actions that are optimal near the others' clone."""
        others = [number for number in range(len(self.data)) if number != left_out]
        angle = list(MODES.values())[left_out]
        counts = self.counts[left_out]
        taken = self.bench.greedy(self._near_clone(price, angle, others))
        return float((counts * taken).sum() / counts.sum())

    def _near_clone(self, price: float, angle: float, demonstrators: Sequence[int]) -> np.ndarray:
        """Return R(α) + η log(β(a|s, α) / max_b β(b|s, α)), of some demonstrators' clone."""
        angles = list(MODES.values())
        parts = shares(jnp.array([angle]), [angles[one] for one in demonstrators], MARGIN)[0]
        visits = sum(
            float(part) * self.visits[one] for part, one in zip(parts, demonstrators, strict=True)
        )
        total, even = np.sum(visits, axis=1, keepdims=True), 1.0 / self.bench.part.mdp.n_actions
        seen = np.where(total > 0, visits / np.maximum(total, 1e-12), even)
        likely = (1.0 - ARBITRARY) * seen + ARBITRARY * even
        return self.bench.reward(angle) + price * np.log(likely / likely.max(axis=1, keepdims=True))

    def _mean_returns(self, angle: float) -> np.ndarray:
        """Return T̄(s, a), the mean return-to-go, scored at an angle; 0 without demonstrations."""
        sums = sum(
            visit_counts(
                one, self.bench.part, score(weights(angle), one.returns("to_go", DISCOUNT))
            )
            for one in self.data
        )
        total = np.sum(self.counts, axis=(0, 1))
        return np.where(total > 0, np.sum(sums, axis=0) / np.maximum(total, 1), 0.0)

    def shared(self) -> list[Row]:
        """Score r_i = f + R(a_i) with the experts' true angles."""
        groups = [
            Group(1.0 / len(MODES), visits, self.bench.reward(angle))
            for visits, angle in zip(self.visits, MODES.values(), strict=True)
        ]
        fitted = fit(self.bench.part.mdp, groups, self.bench.settings)
        return self._rows(
            "shared competence", "", lambda angle: self.bench.reward(angle) + fitted.correction
        )

    def inferred(self) -> tuple[list[Row], Inferred]:
        """Score r_i = f + R(a_i) with inferred angles, and return these."""
        config = self.bench.config
        inferred = infer(
            self.bench.part.mdp,
            self.counts,
            [config.episodes_each] * len(self.counts),
            np.arange(0.0, 90.1, config.grid).tolist(),
            self.bench.settings,
        )
        rows = self._rows(
            "shared competence, angles inferred",
            "",
            lambda angle: self.bench.reward(angle) + inferred.fit.correction,
        )
        return rows, inferred

    def _rows(self, method: str, strength: Any, reward: Any) -> list[Row]:
        return [
            row
            for angle in self.bench.config.angles
            for row in self.bench.rows(method, strength, self.seed, angle, reward(angle))
        ]

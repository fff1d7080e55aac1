"""World of the study: experts with a skill outside the reward pair, and the score of a policy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.rollout import rollout_table
from socialiq.learners.shared_reward.exact import Settings
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum, soft_horizon_optimum
from socialiq.social.angle import score, weights
from socialiq.types import Row
from socialiq.worlds.enumerate import Table
from socialiq_lab.gridworld_runs import Ground


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14, 15, 16, 17, 18, 19)
    """Seeds of the data sets. 0 was used in development."""
    episodes_each: int = 60
    """Demonstrated episodes of each expert."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """Angles at which policies are scored; 0, 45 and 90 are demonstrated."""
    discomfort: float = 0.5
    """Cost of a change of speed by two levels for the experts."""
    strengths: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    """λ of the priors."""
    candidates: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0)
    """λ of the prior on rewards among which the demonstrations choose."""
    prices: tuple[float, ...] = (0.03, 0.1, 0.3, 1.0)
    """η of the improved clone (docs/dial.md) among which the demonstrations choose; in no table."""
    temperature: float = 0.1
    """τ of every method."""
    grid: int = 5
    """Degrees between the candidates for an inferred angle."""
    tolerance: float = 1e-5
    """Largest derivative at which a fit stops."""


@dataclass(frozen=True, eq=False)
class Bench:
    """A world and a skill outside the reward pair, with experts and scores.

    Attributes:
        config: Configuration of the study.
        part: The world's reachable states.
        skill: Reward of comfort in each state and action.
    """

    config: Config
    part: Table
    skill: Float[np.ndarray, "state action"]

    @staticmethod
    def of(config: Config) -> Bench:
        """The 7x7 world."""
        part = Ground.of("crossing7").part
        speed = part.states[:, 1]
        jump = np.abs(speed[:, None] - np.arange(part.mdp.n_actions)) == 2
        return Bench(config, part, -config.discomfort * jump)

    @property
    def settings(self) -> Settings:
        """Settings of every fit."""
        horizon = self.part.world.horizon
        return Settings(horizon, self.config.temperature, tolerance=self.config.tolerance)

    def reward(self, angle: float) -> Float[np.ndarray, "state action"]:
        """R(α), the only reward given to methods."""
        return score(weights(angle), self.part.mdp.rewards)

    def expert(self, angle: float) -> Float[np.ndarray, "time state action"]:
        """Optimal policy for R(α) plus the skill."""
        return self.greedy(self.reward(angle) + self.skill)

    def greedy(self, reward: np.ndarray) -> Float[np.ndarray, "time state action"]:
        """Optimal policy for a reward, with a clock."""
        best = horizon_optimum(self.part.mdp, reward, self.part.world.horizon)
        return best.probabilities(self.part.mdp.n_actions)

    def demonstrations(self, seed: int) -> list[Demonstrations]:
        """Episodes of each expert."""
        return [
            rollout_table(
                self.part,
                self.expert(angle),
                self.config.episodes_each,
                seed=len(MODES) * seed + number,
                mode=mode,
            ).transitions
            for number, (mode, angle) in enumerate(MODES.items())
        ]

    def soft(self, reward: np.ndarray) -> Float[np.ndarray, "time state action"]:
        """Soft optimum of a reward, with a clock."""
        settings = self.settings
        return soft_horizon_optimum(
            self.part.mdp, reward, settings.horizon, settings.temperature
        ).probabilities

    def rows(self, method: str, strength: Any, seed: Any, angle: float, reward: Any) -> list[Row]:
        """Score the greedy and the soft optimum of a method's reward."""
        policies = {"greedy": self.greedy(reward), "soft": self.soft(reward)}
        return [
            self._row(method, strength, seed, angle, readout, policies[readout])
            for readout in READOUTS
        ]

    def _row(
        self, method: str, strength: Any, seed: Any, angle: float, readout: str, policy: np.ndarray
    ) -> Row:
        label = {"method": method, "strength": strength, "seed": seed, "angle": angle}
        shown = {"demonstrated": int(angle in MODES.values()), "readout": readout}
        return label | shown | self._score(policy, angle)

    def _score(self, policy: np.ndarray, angle: float) -> Row:
        """Return the reward, scaled to 1 for the optimum and 0 for uniformly random actions."""
        whole = self.reward(angle) + self.skill
        horizon, mdp = self.part.world.horizon, self.part.mdp
        best = horizon_optimum(mdp, whole, horizon).value
        even = np.full((mdp.n_states, mdp.n_actions), 1.0 / mdp.n_actions)
        visits, random = (
            horizon_evaluation(mdp, chances, horizon).visits for chances in (policy, even)
        )
        value, base = (float((each * whole).sum()) for each in (visits, random))
        return {
            "score": (value - base) / (best - base),
            "skill": float((visits * self.skill).sum()),
        }

    def without_data(self) -> Iterator[Row]:
        """Score reinforcement learning on R(α) alone, and on R(α) plus the skill (the oracle).

        And the demonstrators: the one of the nearest angle, and the best of them in hindsight.
        """
        experts = {angle: self.expert(angle) for angle in MODES.values()}
        for angle in self.config.angles:
            nearest = experts[min(experts, key=lambda one: abs(one - angle))]
            best = max(experts.values(), key=lambda one: self._score(one, angle)["score"])
            for name, one in (("nearest", nearest), ("best", best)):
                yield self._row(f"{name} demonstrator", "", "", angle, "greedy", one)
            yield from self.rows("RL on R(α)", "", "", angle, self.reward(angle))
            yield from self.rows("oracle", "", "", angle, self.reward(angle) + self.skill)

"""A skill that all demonstrators have and the reward pair doesn't express, and how it is scored."""

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
from socialiq.experiments.gridworld_runs import Ground
from socialiq.learners.shared_reward.exact import Settings
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum, soft_horizon_optimum
from socialiq.social.angle import score, weights
from socialiq.types import Row
from socialiq.worlds.enumerate import Table


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14, 15, 16, 17, 18, 19)
    """Seeds of the data sets. 0 was used in development."""
    episodes_each: int = 60
    """Demonstrated episodes of each expert."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """At which policies are scored; 0, 45 and 90 are demonstrated."""
    discomfort: float = 0.5
    """Cost of a change of speed by two levels for the experts."""
    strengths: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    """λ of the priors."""
    temperature: float = 0.1
    """τ of every method."""
    grid: int = 5
    """Degrees between the angles that are inferred from."""
    tolerance: float = 1e-5
    """Largest derivative at which a fit stops."""


@dataclass(frozen=True, eq=False)
class Bench:
    """The world, the skill that is not in the reward pair, and how policies are scored.

    Attributes:
        config: Of the study.
        part: The world's reachable states.
        skill: What comfort is worth in each state and action.
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
        """Optimal for R(α) and the skill."""
        return self.greedy(self.reward(angle) + self.skill)

    def greedy(self, reward: np.ndarray) -> Float[np.ndarray, "time state action"]:
        """Optimal for a reward, with a clock."""
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

    def rows(self, method: str, strength: Any, seed: Any, angle: float, reward: Any) -> list[Row]:
        """Score of the greedy and the soft optimum of a reward that a method came to."""
        settings = self.settings
        policies = {
            "greedy": self.greedy(reward),
            "soft": soft_horizon_optimum(
                self.part.mdp, reward, settings.horizon, settings.temperature
            ).probabilities,
        }
        return [
            {
                "method": method,
                "strength": strength,
                "seed": seed,
                "angle": angle,
                "demonstrated": int(angle in MODES.values()),
                "readout": readout,
            }
            | self._score(policies[readout], angle)
            for readout in READOUTS
        ]

    def _score(self, policy: np.ndarray, angle: float) -> Row:
        """1 for the optimum of R(α) and the skill, 0 for even chances."""
        whole = self.reward(angle) + self.skill
        horizon, mdp = self.part.world.horizon, self.part.mdp
        best = horizon_optimum(mdp, whole, horizon).value
        even = np.full((mdp.n_states, mdp.n_actions), 1.0 / mdp.n_actions)
        worth, base = (
            float((horizon_evaluation(mdp, one, horizon).visits * whole).sum())
            for one in (policy, even)
        )
        visits = horizon_evaluation(mdp, policy, horizon).visits
        return {
            "score": (worth - base) / (best - base),
            "skill": float((visits * self.skill).sum()),
        }

    def without_data(self) -> Iterator[Row]:
        """Reinforcement learning on R(α) alone, and the oracle that knows the skill."""
        for angle in self.config.angles:
            yield from self.rows("RL on R(α)", "", "", angle, self.reward(angle))
            yield from self.rows("oracle", "", "", angle, self.reward(angle) + self.skill)

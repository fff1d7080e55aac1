"""Do demonstrations add anything beyond reinforcement learning on the hand-written reward?

All experts of the 7x7 world also drive comfortably: they shun changes of speed by two levels, which
neither r_env nor r_social speaks of. Each method gets the experts' demonstrations for 0, 45 and 90
degrees and the reward pair, and is scored on R(α) plus the comfort that it was never told of, also
at angles that nobody demonstrated. All methods are solved exactly, so only the data are random.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS
from socialiq.evaluation.rollout import rollout_table
from socialiq.evaluation.tally import tally
from socialiq.learners.competence.angles import Inferred, infer
from socialiq.learners.competence.exact import Group, Settings, fit
from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum, soft_horizon_optimum
from socialiq.social.angle import weights
from socialiq.social.score import score
from socialiq.thesis.experts import MODES
from socialiq.thesis.lanes import Ground, Watch, silent
from socialiq.thesis.store import Results, Row
from socialiq.worlds.enumerate import Table

STUDY = "competence"
DISCOUNT = 0.99  # of returns-to-go, as in the thesis
C, W = 0.5, 1.0  # χ² and prior weight of the thesis; their sum shrinks, m = wλT / (c + w)


@dataclass(frozen=True)
class Config:
    """What the study runs; the defaults are the committed results."""

    seeds: tuple[int, ...] = (10, 11, 12, 13, 14, 15, 16, 17, 18, 19)
    """Of the data sets. 0 was used in development."""
    episodes_each: int = 60
    """Demonstrated episodes of each expert."""
    angles: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0)
    """At which policies are scored; 0, 45 and 90 are demonstrated."""
    discomfort: float = 0.5
    """What a change of speed by two levels costs the experts."""
    strengths: tuple[float, ...] = (0.3, 1.0, 3.0, 10.0)
    """λ of the priors."""
    temperature: float = 0.1
    """τ of every method."""
    grid: int = 5
    """Degrees between the angles that are inferred from."""


def run(config: Config | None = None, watch: Watch = silent) -> Results:
    """Fit every method to every data set, evaluate exactly, and tabulate.

    Args:
        config: What to run.
        watch: Not used; the study takes minutes.
    """
    del watch
    config = config or Config()
    bench = Bench.of(config)
    rows = list(bench.without_data())
    angles: list[Row] = []
    for seed in config.seeds:
        told = _Told.of(bench, bench.demonstrations(seed), seed)
        rows += told.imitation()
        rows += told.priors()
        rows += told.shared()
        more, inferred = told.inferred()
        rows += more
        angles += _angle_rows(seed, inferred)
    tables = {"scores": rows, "pooled": _pooled(rows), "angles": angles}
    return Results.of(STUDY, config, tables, _summary(tables))


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
        """Of every fit."""
        return Settings(self.part.world.horizon, self.config.temperature)

    def reward(self, angle: float) -> Float[np.ndarray, "state action"]:
        """R(α), all that methods are told."""
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


class _Told(NamedTuple):
    """What a method is told: the reward pair and one data set."""

    bench: Bench
    seed: int
    data: list[Demonstrations]
    counts: list[np.ndarray]

    @staticmethod
    def of(bench: Bench, data: list[Demonstrations], seed: int) -> _Told:
        return _Told(bench, seed, data, [tally(one, bench.part) for one in data])

    @property
    def visits(self) -> list[np.ndarray]:
        """Mean number of times per episode, of each expert."""
        episodes = self.bench.config.episodes_each
        return [one.sum(axis=0) / episodes for one in self.counts]

    @property
    def pooled(self) -> np.ndarray:
        """The same of the mixture with equal numbers of episodes."""
        return np.mean(self.visits, axis=0)

    def imitation(self) -> list[Row]:
        """IQ-Learn without a prior: one policy for every angle."""
        zero = np.zeros_like(self.bench.skill)
        settings = self.bench.settings._replace(shrinkage=C)
        found = fit(self.bench.part.mdp, [Group(1.0, self.pooled, zero)], settings)
        return self._rows("IQ-Learn, no prior", "", lambda _: found.correction)

    def priors(self) -> list[Row]:
        """The thesis' prior on returns-to-go, and the same on the rewards themselves."""
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

    def _prior(self, centre: np.ndarray) -> np.ndarray:
        """r̂ of IQ-Learn with a prior: every demonstrator is taken for one of the target angle."""
        moved = W / (C + W) * centre
        settings = self.bench.settings._replace(shrinkage=C + W)
        found = fit(self.bench.part.mdp, [Group(1.0, self.pooled, moved)], settings)
        return moved + found.correction

    def _mean_returns(self, angle: float) -> np.ndarray:
        """T̄(s, a): mean return-to-go, scored at an angle; 0 where nothing is demonstrated."""
        sums = sum(
            tally(one, self.bench.part, score(weights(angle), one.returns("to_go", DISCOUNT)))
            for one in self.data
        )
        total = np.sum(self.counts, axis=(0, 1))
        return np.where(total > 0, np.sum(sums, axis=0) / np.maximum(total, 1), 0.0)

    def shared(self) -> list[Row]:
        """r_i = f + R(a_i) with the experts' own angles."""
        groups = [
            Group(1.0 / len(MODES), visits, self.bench.reward(angle))
            for visits, angle in zip(self.visits, MODES.values(), strict=True)
        ]
        found = fit(self.bench.part.mdp, groups, self.bench.settings)
        return self._rows(
            "shared competence", "", lambda angle: self.bench.reward(angle) + found.correction
        )

    def inferred(self) -> tuple[list[Row], Inferred]:
        """The same with angles inferred."""
        config = self.bench.config
        found = infer(
            self.bench.part.mdp,
            self.counts,
            [config.episodes_each] * len(self.counts),
            np.arange(0.0, 90.1, config.grid).tolist(),
            self.bench.settings,
        )
        rows = self._rows(
            "shared competence, angles inferred",
            "",
            lambda angle: self.bench.reward(angle) + found.fit.correction,
        )
        return rows, found

    def _rows(self, method: str, strength: Any, reward: Any) -> list[Row]:
        return [
            row
            for angle in self.bench.config.angles
            for row in self.bench.rows(method, strength, self.seed, angle, reward(angle))
        ]


def _angle_rows(seed: int, inferred: Inferred) -> list[Row]:
    return [
        {"seed": seed, "mode": mode, "true_angle": angle, "round": number, "mean": float(mean)}
        for number, means in enumerate(inferred.path)
        for (mode, angle), mean in zip(MODES.items(), means, strict=True)
    ]


def _pooled(rows: Sequence[Row]) -> list[Row]:
    """Mean score over seeds by method, strength and readout: all, demonstrated, unseen angles."""
    groups: dict[tuple, list[Row]] = {}
    for row in rows:
        groups.setdefault((row["method"], row["strength"], row["readout"]), []).append(row)
    found = []
    for (method, strength, readout), group in groups.items():
        kinds = {
            "all": group,
            "demonstrated": [row for row in group if row["demonstrated"]],
            "unseen": [row for row in group if not row["demonstrated"]],
        }
        found.append(
            {"method": method, "strength": strength, "readout": readout}
            | {f"score_{kind}": _mean(some, "score") for kind, some in kinds.items()}
            | {"score_worst": min(row["score"] for row in group)}
            | {"skill_all": _mean(group, "skill")}
        )
    return found


def best_strengths(pooled: Sequence[Row]) -> dict[str, Any]:
    """For each method the strength with the best greedy score over all angles, in hindsight."""
    best: dict[str, Row] = {}
    for row in pooled:
        if row["readout"] == "greedy":
            leader = best.setdefault(row["method"], row)
            if row["score_all"] > leader["score_all"]:
                best[row["method"]] = row
    return {method: row["strength"] for method, row in best.items()}


def _mean(rows: Sequence[Row], name: str) -> float:
    return float(np.mean([row[name] for row in rows]))


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Pooled scores by method (with its strength) and readout, and the inferred angles."""
    found: dict[str, Any] = {}
    for row in tables["pooled"]:
        name = row["method"] + (f", λ {row['strength']:g}" if row["strength"] != "" else "")
        entry = {key: value for key, value in row.items() if key.startswith(("score", "skill"))}
        found.setdefault(name, {})[row["readout"]] = entry
    last = max(row["round"] for row in tables["angles"])
    angles = {
        mode: _mean(
            [row for row in tables["angles"] if (row["mode"], row["round"]) == (mode, last)],
            "mean",
        )
        for mode in MODES
    }
    return {"methods": found, "inferred_angles": angles}

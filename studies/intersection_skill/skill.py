"""The hidden skill, as a reward c h(s, a, s'), and episodes that are scored with it.

    h = - |v' - v| / 4.5 m/s - [the ego stands in the junction in s']

counts changes of speed, in levels between two target speeds, and decisions that end with the ego
in the way of others: smooth driving that keeps the junction clear. Neither r_env nor r_social
contains it. Only demonstrators are rewarded for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq.errors import UserError
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.play import record
from socialiq.learners.collect import Act, Source
from socialiq.learners.expert_table import Batch as Rows
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy, ValuePolicy
from socialiq.social.angle import exact_weights
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import Policy, RewardPair
from socialiq.worlds.highway.state import FEATURES
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.policies import STOP_LINE
from socialiq.worlds.intersection.state import POSITION_RANGE, SPEED_RANGE
from socialiq_lab.intersection.driving import BATCH
from socialiq_lab.intersection.episodes import DIAL, EpisodesRun, angle_file
from socialiq_lab.jobs import ProgressCallback

LEVEL = 4.5
"""Difference of two target speeds in m/s."""
STANDING = 1.0
"""Speed in m/s below which the ego stands."""


def skill(
    observation: Float[np.ndarray, "step feature"],
    following: Float[np.ndarray, "step feature"],
) -> Float[np.ndarray, " step"]:
    """Return the skill h of each transition, at most 0.

    Args:
        observation: Observation in which the ego decided.
        following: Observation a decision later.
    """
    return -levels_changed(observation, following) - stands_in_junction(following)


def levels_changed(
    observation: Float[np.ndarray, "step feature"],
    following: Float[np.ndarray, "step feature"],
) -> Float[np.ndarray, " step"]:
    """Return the change of the ego's speed in levels, in either direction."""
    return np.abs(speed(following) - speed(observation)) / LEVEL


def speed(observation: Float[np.ndarray, "step feature"]) -> Float[np.ndarray, " step"]:
    """Return the ego's speed in m/s."""
    across, along = FEATURES.index("vx"), FEATURES.index("vy")
    return np.hypot(observation[:, across], observation[:, along]) * SPEED_RANGE


def stands_in_junction(
    observation: Float[np.ndarray, "step feature"],
) -> Bool[np.ndarray, " step"]:
    """Whether the ego's centre is between the stop lines of all arms, and the ego stands."""
    columns = [FEATURES.index("x"), FEATURES.index("y")]
    inside = (np.abs(observation[:, columns]) * POSITION_RANGE < STOP_LINE).all(axis=1)
    return inside & (speed(observation) < STANDING)


def with_skill(source: Source, weight: float, angle: float) -> Source:
    """Return the same experience with a reward pair whose score at the angle is R(α) + c h.

    h is put along (cos α, sin α), which has length 1; the pair has no meaning at another angle.

    Args:
        source: Source of the experience.
        weight: Weight c of the skill.
        angle: α in degrees.
    """
    direction = exact_weights(angle)

    def source_with_skill(act: Act, rng: np.random.Generator) -> Rows:
        batch = source(act, rng)
        h = skill(np.asarray(batch.observation), np.asarray(batch.next_observation))
        worth = (weight * h).astype(np.float32)
        pair = RewardPair(
            batch.target.env + np.float32(direction.env) * worth,
            batch.target.social + np.float32(direction.social) * worth,
        )
        return batch._replace(target=pair)

    return source_with_skill


class ScoredEpisodes(NamedTuple):
    """Episodes, each array (episode,).

    Attributes:
        env: Sum of r_env.
        social: Sum of r_social.
        changes: Changes of speed in either direction, summed, in levels of 4.5 m/s.
        standing: Decisions that ended with the ego standing in the junction.
        ending: Values of `Ending`.
        length: Decisions.
    """

    env: Float[np.ndarray, " episode"]
    social: Float[np.ndarray, " episode"]
    changes: Float[np.ndarray, " episode"]
    standing: Float[np.ndarray, " episode"]
    ending: Int64[np.ndarray, " episode"]
    length: Int64[np.ndarray, " episode"]

    def reward(self, angle: float) -> Float[np.ndarray, " episode"]:
        """Return R(α) of each episode, the reward given to learners."""
        direction = exact_weights(angle)
        return direction.env * self.env + direction.social * self.social

    def skill(self) -> Float[np.ndarray, " episode"]:
        """Return the skill h of each episode, which is not given to learners."""
        return -self.changes - self.standing

    def score(self, angle: float, weight: float) -> Float[np.ndarray, " episode"]:
        """Return R(α) + c h of each episode, undiscounted; c is the weight."""
        return self.reward(angle) + weight * self.skill()


def drive(batch: Batch, policy: Policy, seeds: np.ndarray) -> ScoredEpisodes:
    """Run one greedy episode of a policy for each seed."""
    made = record(batch, policy, seeds, "driven").transitions
    changed = levels_changed(made.observation, made.next_observation)
    totals = made.totals()
    last = np.append(made.episode_starts[1:], made.n_transitions) - 1
    return ScoredEpisodes(
        totals.env,
        totals.social,
        np.bincount(made.episode, changed),
        np.bincount(made.episode, stands_in_junction(made.next_observation)),
        made.ending[last].astype(np.int64),
        made.episode_lengths.astype(np.int64),
    )


@dataclass(frozen=True)
class ScoredRun(EpisodesRun):
    """Episodes at some angles.

    The inputs hold a dial, or policies of some angles; at any other angle the nearest one drives.
    """

    angles: tuple[float, ...]
    sha256: tuple[str, ...] = ()
    """SHA-256 of the atlas' experts, if they drive instead of the inputs."""


def evaluate(
    config: ScoredRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the outcome of every greedy episode, one file for each angle."""
    batch = Batch(config.options, BATCH)
    policies = policies_at(config.angles, list(inputs.values()))
    for number, (angle, policy) in enumerate(zip(config.angles, policies, strict=True), start=1):
        driven = drive(batch, policy, config.seeds)
        save_arrays(folder / angle_file(angle), "skill-episodes", 1, driven._asdict(), {})
        on_progress(number / len(config.angles))


def load(folder: Path, angle: float) -> ScoredEpisodes:
    """Read the episodes that `evaluate` wrote of an angle.

    Raises:
        UserError: If the file is missing or damaged.
    """
    arrays, _ = load_arrays(folder / angle_file(angle), "skill-episodes", 1)
    return ScoredEpisodes(**arrays)


def policies_at(angles: Sequence[float], folders: Sequence[Path]) -> list[ValuePolicy]:
    """Return the policy of each angle: a dial's, that of the nearest angle, or the atlas'.

    Args:
        angles: In degrees.
        folders: Folders of trained policies; none for the atlas' experts.

    Raises:
        UserError: If a file is damaged, or there is no policy.
    """
    if len(folders) == 1 and (folders[0] / DIAL).is_file():
        family = DialPolicy.load(folders[0] / DIAL)
        return [family.at(angle) for angle in angles]
    if not folders:
        found = {angle: atlas.load(unskilled_name(mode)) for mode, angle in MODES.items()}
    else:
        paths = [path for folder in folders for path in sorted(folder.glob("*.safetensors"))]
        found = {float(path.stem): QPolicy.load(path) for path in paths}
    if not found:
        raise UserError("no policies to drive: train them first")
    return [found[nearest(angle, list(found))] for angle in angles]


def nearest(angle: float, among: Sequence[float]) -> float:
    """Return the nearest of some angles; of two the smaller."""
    return min(sorted(among), key=lambda one: abs(one - angle))


def unskilled_name(mode: str) -> str:
    """Return the name of the atlas' expert that is trained on R(α) alone."""
    return f"set_{mode}"

"""Episodes of a method at some angles, with all that the score is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64

from socialiq.errors import UserError
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.play import record
from socialiq.experiments.intersection.jobs import BATCH
from socialiq.experiments.jobs import ProgressCallback
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights
from socialiq.storage import load_arrays, save_arrays
from socialiq.studies.intersection_skill.skill import levels_changed, stands_in_junction
from socialiq.types import Policy
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options

DIAL = "dial.safetensors"
KIND = "skill-episodes"
SCHEMA_VERSION = 1


class Driven(NamedTuple):
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

    def told(self, angle: float) -> Float[np.ndarray, " episode"]:
        """Return R(α) of each episode, the reward given to learners."""
        direction = exact_weights(angle)
        return direction.env * self.env + direction.social * self.social

    def skill(self) -> Float[np.ndarray, " episode"]:
        """Return the skill h of each episode, which is not given to learners."""
        return -self.changes - self.standing

    def score(self, angle: float, weight: float) -> Float[np.ndarray, " episode"]:
        """R(α) + c h of each episode, undiscounted; c is the weight."""
        return self.told(angle) + weight * self.skill()


def drive(batch: Batch, policy: Policy, seeds: np.ndarray) -> Driven:
    """Let a policy drive one episode for each seed, greedily."""
    made = record(batch, policy, seeds, "driven").transitions
    changed = levels_changed(made.observation, made.next_observation)
    totals = made.totals()
    last = np.append(made.episode_starts[1:], made.n_transitions) - 1
    return Driven(
        totals.env,
        totals.social,
        np.bincount(made.episode, changed),
        np.bincount(made.episode, stands_in_junction(made.next_observation)),
        made.ending[last].astype(np.int64),
        made.episode_lengths.astype(np.int64),
    )


@dataclass(frozen=True)
class Driving:
    """Episodes at some angles, on seeds that all policies share.

    The inputs hold a dial, or policies of some angles; at any other angle the nearest one drives.
    """

    angles: tuple[float, ...]
    episodes: int = 2000
    first_seed: int = 20_000_000
    sha256: tuple[str, ...] = ()
    """SHA-256 of the atlas' experts, if they drive instead of the inputs."""
    options: Options = field(default_factory=Options)


def evaluate(
    config: Driving, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Drive greedily; writes what became of every episode, one file for each angle."""
    seeds = np.arange(config.first_seed, config.first_seed + config.episodes)
    batch = Batch(config.options, BATCH)
    policies = policies_at(config.angles, list(inputs.values()))
    for number, (angle, policy) in enumerate(zip(config.angles, policies, strict=True), start=1):
        driven = drive(batch, policy, seeds)
        save_arrays(folder / policy_name(angle), KIND, SCHEMA_VERSION, driven._asdict(), {})
        on_progress(number / len(config.angles))


def load(folder: Path, angle: float) -> Driven:
    """Rows that `evaluate` wrote about an angle.

    Raises:
        UserError: If the file is missing or damaged.
    """
    arrays, _ = load_arrays(folder / policy_name(angle), KIND, SCHEMA_VERSION)
    return Driven(**arrays)


def policies_at(angles: Sequence[float], folders: Sequence[Path]) -> list[QPolicy]:
    """The policy of each angle: of a dial, of the nearest angle there is, or of the atlas.

    Args:
        angles: In degrees.
        folders: Of trained policies; none for the atlas' experts.

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
        raise UserError("no policies to drive: do the trainings first")
    return [found[nearest(angle, list(found))] for angle in angles]


def nearest(angle: float, among: Sequence[float]) -> float:
    """The nearest of some angles; of two the smaller."""
    return min(sorted(among), key=lambda one: abs(one - angle))


def unskilled_name(mode: str) -> str:
    """In the atlas: the expert of R(α) alone."""
    return f"set_{mode}"


def policy_name(angle: float) -> str:
    """File of what belongs to an angle."""
    return f"{angle:g}.safetensors"

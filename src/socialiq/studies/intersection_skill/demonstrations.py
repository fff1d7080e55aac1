"""Demonstrations: episodes recorded once, of which every training seed draws its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_transitions
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.play import record
from socialiq.experiments.intersection.jobs import BATCH
from socialiq.experiments.jobs import ProgressCallback
from socialiq.nn.q_policy import QPolicy
from socialiq.studies.intersection_skill.driving import policy_name
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection


@dataclass(frozen=True)
class Recording:
    """Episodes of each demonstrator."""

    episodes: int
    first_seed: int = 11_000_000
    options: Options = field(default_factory=Options)


def record_demonstrators(
    config: Recording, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Roll out each demonstrator, all in the order of the modes; writes a pool of each."""
    for number, ((mode, angle), trained) in enumerate(
        zip(MODES.items(), inputs.values(), strict=True)
    ):
        first = config.first_seed + number * config.episodes
        seeds = np.arange(first, first + config.episodes)
        policy = QPolicy.load(trained / policy_name(angle))
        source = {"world": Intersection(config.options).description, "expert": policy.provenance}
        made = record(Batch(config.options, BATCH), policy, seeds, mode, dict(source))
        files.save(folder / f"{mode}.safetensors", made.transitions)
        on_progress((number + 1) / len(MODES))


def demonstrations(pools: Path, size: int, seed: int) -> dict[str, Demonstrations]:
    """About so many transitions of each demonstrator, in whole episodes that the seed draws."""
    found = {}
    for mode in MODES:
        pool = {mode: files.load(pools / f"{mode}.safetensors")}
        found[mode] = equal_transitions(pool, size, seed)
    return found

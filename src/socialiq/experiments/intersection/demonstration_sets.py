"""The demonstrations that learners draw their mixtures from: episodes of the three experts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from socialiq.demonstrations import files
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.play import record
from socialiq.experiments.intersection.jobs import BATCH, BEST
from socialiq.experiments.jobs import Job, ProgressCallback
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import save_arrays
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

DEMONSTRATIONS = "demonstrations/experts"
"""Folder of the recordings, in every study."""
RECORDED_EPISODES = 3000
"""Episodes recorded of each expert."""
MIXTURE, SIZE = "equal_transitions", 15_000
"""The mixture that learners see: transitions of each expert (thesis 6.3)."""


@dataclass(frozen=True)
class Recording:
    """Episodes of the three experts."""

    file: str = BEST
    episodes: int = RECORDED_EPISODES
    first_seed: int = 10_000_000
    options: Options = field(default_factory=Options)


def record_demonstrations(
    config: Recording, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Roll out each expert; writes a pool of each, and its classical rewards row for row."""
    experts = [QPolicy.load(trained / config.file) for trained in inputs.values()]
    _record(dict(zip(MODES, experts, strict=True)), config, folder, on_progress)


@dataclass(frozen=True)
class AtlasRecording(Recording):
    """Episodes of the three experts of the atlas."""

    file: str = "atlas"
    sha256: tuple[str, ...] = ()
    """SHA-256 of the experts: another atlas gives other demonstrations."""


def record_atlas(
    config: AtlasRecording, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Roll out each expert of the atlas, as the intersection study does with those it trains."""
    _record({mode: atlas.load(f"expert_{mode}") for mode in MODES}, config, folder, on_progress)


def atlas_demonstrations(episodes: int) -> Job:
    """Demonstrations for studies that train no experts of their own.

    Raises:
        UserError: If the atlas did not come with the package.
    """
    entries = atlas.manifest()
    sha256 = tuple(entries[f"expert_{mode}"]["sha256"] for mode in MODES)
    run = AtlasRecording(episodes=episodes, sha256=sha256)
    return Job(DEMONSTRATIONS, record_atlas, run, cost=20.0)


def _record(
    experts: Mapping[str, QPolicy], config: Recording, folder: Path, on_progress: ProgressCallback
) -> None:
    for number, (mode, policy) in enumerate(experts.items()):
        first = config.first_seed + number * config.episodes
        source = {"world": Intersection(config.options).description, "expert": policy.provenance}
        seeds = np.arange(first, first + config.episodes)
        made = record(Batch(config.options, BATCH), policy, seeds, mode, dict(source))
        files.save(folder / f"{mode}.safetensors", made.transitions)
        classical = {"own": made.classical.env, "others": made.classical.social}
        save_arrays(folder / f"{mode}_classical.safetensors", "classical", 1, classical, {})
        on_progress((number + 1) / len(experts))

"""Demonstrations of the intersection's experts: recordings, and mixtures drawn from them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from socialiq import Demonstrations
from socialiq.demonstrations import files
from socialiq.demonstrations.mixture import MIXTURES
from socialiq.evaluation.rollout import MODES, record
from socialiq.storage import save_arrays
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.world import Batch, Intersection
from socialiq_lab.intersection.driving import BATCH, Driving, drivers_of
from socialiq_lab.jobs import Job, ProgressCallback

DEMONSTRATIONS = "demonstrations/experts"
"""Folder of the recordings, in every study."""
RECORDED_EPISODES = 3000
"""Episodes recorded of each expert."""
MIXTURE, SIZE = "equal_transitions", 15_000
"""Mixture that learners get: transitions of each expert (thesis 6.3)."""


@dataclass(frozen=True, kw_only=True)
class Recording(Driving):
    """Greedy episodes of each of the three experts, on seeds of their own."""

    episodes: int = RECORDED_EPISODES
    first_seed: int = 10_000_000
    sha256: tuple[str, ...] = ()
    """SHA-256 of the experts of the atlas; none for experts that the inputs hold."""


def record_experts(
    config: Recording, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the transitions of each expert, and their classical rewards row for row.

    The inputs' files are the experts in the order of the modes; without inputs it is the atlas.
    """
    experts = [
        driver
        for name, trained in inputs.items()
        for driver in drivers_of(config, {name: trained}).values()
    ] or [atlas.load(f"expert_{mode}") for mode in MODES]
    for number, (mode, policy) in enumerate(zip(MODES, experts, strict=True)):
        source = {"world": Intersection(config.options).description, "expert": policy.provenance}
        seeds = config.seeds + number * config.episodes
        recorded = record(Batch(config.options, BATCH), policy, seeds, mode, dict(source))
        files.save(folder / f"{mode}.safetensors", recorded.transitions)
        classical = {"own": recorded.classical.env, "others": recorded.classical.social}
        save_arrays(folder / f"{mode}_classical.safetensors", "classical", 1, classical, {})
        on_progress((number + 1) / len(experts))


def atlas_demonstrations(episodes: int) -> Job:
    """Return the job that records demonstrations for studies without experts of their own.

    Raises:
        UserError: If the atlas did not come with the package.
    """
    entries = atlas.manifest()
    sha256 = tuple(entries[f"expert_{mode}"]["sha256"] for mode in MODES)
    recording = Recording(episodes=episodes, sha256=sha256)
    return Job(DEMONSTRATIONS, record_experts, recording, cost=20.0)


def mixture_of(recordings: Path, mixture: str, size: int, seed: int) -> Demonstrations:
    """Draw a mixture of all three experts from a folder of recordings.

    Args:
        recordings: Folder of the recordings.
        mixture: One of `MIXTURES`.
        size: Transitions or episodes of each expert, as the mixture counts.
        seed: Seed of the draw.
    """
    pools = {
        mode: files.load(recordings / f"{mode}.safetensors", continuous=True) for mode in MODES
    }
    return MIXTURES[mixture](pools, size, seed)

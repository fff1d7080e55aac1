"""Drivers and driving jobs of the intersection: episodes on common seeds, and demonstrations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from socialiq import Demonstrations, QPolicy
from socialiq.demonstrations import files
from socialiq.demonstrations.mixture import MIXTURES
from socialiq.evaluation.branching import with_oracle_lookahead
from socialiq.evaluation.dial import Sweep, calibrated
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.measures import Episodes
from socialiq.evaluation.online_planning import RolloutPolicy
from socialiq.evaluation.rollout import MODES, record
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.dial_policy import Dial, DialPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.saved import load_one_of
from socialiq.results_folder import as_csv
from socialiq.storage import load_arrays, packaged_results, save_arrays, write_atomically
from socialiq.types import Memoryless, Row
from socialiq.worlds.grammar import road_of
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.intersection import atlas, policies
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab.jobs import Inputs, Job, ProgressCallback

BEST = "best.safetensors"
LAST = "last.safetensors"
DIAL = "dial.safetensors"
"""Files of a training job: the best network by checks, the last one, a dial."""
EPISODES = 2000
FIRST_EPISODE = 20_000_000
"""Evaluation episodes of a policy, and the seed of the first, the same for all policies."""
FIRST_CALIBRATION = 15_000_000
"""First seed of the episodes that select a dial's settings."""
FIRST_HIGHWAY_EPISODE = 30_000_000
"""Seed of the first episode on the real highway-env."""
BATCH = 512
PLANNED_BATCH = 128
"""Episodes side by side, and where each has many imagined ones."""
Ahead = Literal["", "planned", "lookahead"]
"""Online planning, or oracle lookahead."""
_POLICIES = (EnsemblePolicy, ActorPolicy, ActorDial, DialPolicy, QPolicy)


@dataclass(frozen=True)
class Deciding(Memoryless):
    """A policy by a function of a batch of observations, the time with them or not."""

    n_features: int
    decide: Callable[[np.ndarray], np.ndarray]

    def choose(self, observation: np.ndarray, _deterministic: bool, /) -> np.ndarray:
        """Choose one action for each row.

        Args:
            observation: Batch of observations, (batch, features).
            _deterministic: Not used.
        """
        return self.decide(observation)


@dataclass(frozen=True, kw_only=True)
class EpisodesRun:
    """Episodes on seeds that all policies share."""

    episodes: int = EPISODES
    first_seed: int = FIRST_EPISODE
    options: Options = field(default_factory=Options)
    shift: str = ""  # of the world, and the front end of policies there
    front_end: str = ""

    @property
    def world(self) -> Any:
        """World of the episodes."""
        return road_of(self.options).shifted(self.shift, self.front_end)

    @property
    def seeds(self) -> np.ndarray:
        """Seed of each episode."""
        return np.arange(self.first_seed, self.first_seed + self.episodes)


@dataclass(frozen=True, kw_only=True)
class Driving(EpisodesRun):
    """Episodes of policies by readout, or of dials by angle."""

    driver: str = "**/*.safetensors"
    """Pattern of files in the input's folder; without an input the name of a rule-based driver."""
    readouts: tuple[str, ...] = ("greedy",)
    angles: tuple[float, ...] = ()
    """Angles of a dial in degrees; of a policy with oracle lookahead, its own."""
    ahead: Ahead = ""


def drive(config: Driving, folder: Path, inputs: Inputs, on_progress: ProgressCallback) -> None:
    """Write the outcome of every episode, a file for each policy and readout or angle.

    Args:
        config: The policies, and the episodes that they drive.
        folder: Folder of the job.
        inputs: Folder of the job that trained the policies; empty for a rule-based driver.
        on_progress: Called with the share of the files that are written.
    """
    drivers = drivers_of(config, inputs)
    chosen: Any = config.angles or config.readouts
    cells = [(name, cell) for name in drivers for cell in chosen]
    for number, (name, cell) in enumerate(cells, start=1):
        driver = drivers[name]
        policy = driver.at(cell) if isinstance(driver, Dial) else driver
        if config.ahead == "lookahead":
            episodes = with_oracle_lookahead(config.options, policy, config.seeds, cell)
        elif config.ahead == "planned":
            discount = driver.provenance["numbers"]["discount"]
            policy = RolloutPolicy(policy, config.options, cell, discount=discount)
            episodes = episodes_of(
                Intersection(config.options).batch(PLANNED_BATCH), policy, config.seeds
            )
        else:
            batch = config.world.batch(BATCH)
            episodes = episodes_of(batch, policy, config.seeds, deterministic=cell != "soft")
        save_episodes(episodes_at(folder, name, cell), episodes)
        on_progress(number / len(cells))


def evaluation(trained: str, config: Driving, cost: float) -> Job:
    """Return the job that drives the policies of another job.

    Args:
        trained: Name of the job that trained the policies.
        config: Configuration of the drives.
        cost: Approximate seconds.
    """
    return Job(f"evaluation/{trained}", drive, config, (trained,), cost)


def episodes_at(folder: Path, driver: str, cell: str | float = "greedy") -> Path:
    """Return the path of a driver's episodes.

    Args:
        folder: Folder of the job.
        driver: File of the driver below its job's folder, or the name of a rule-based one.
        cell: Readout of a policy, or angle of a dial in degrees.
    """
    name = cell if isinstance(cell, str) else f"{cell:g}"
    return folder / driver.removesuffix(".safetensors") / f"{name}.safetensors"


def drivers_of(config: Driving, inputs: Inputs) -> dict[str, Any]:
    """Return the drivers of a job.

    Args:
        config: Its `driver` is a pattern of files, or the name of a rule-based driver.
        inputs: Folders of jobs that trained policies; empty for a rule-based driver.

    Returns:
        The trained policies by file in their folder, sorted, behind the name of the job if there
        are several; or the rule-based driver by its name.
    """
    if not inputs:
        return {config.driver: policies.policy(config.driver, config.first_seed)}
    files = {
        (Path() if len(inputs) == 1 else Path(job)) / file.relative_to(trained): file
        for job, trained in inputs.items()
        for file in sorted(trained.glob(config.driver))
    }
    return {name.as_posix(): load_one_of(file, _POLICIES) for name, file in files.items()}


def drive_highway(
    config: Driving, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Compare the core with the real highway-env decision by decision; a row for each episode.

    Args:
        config: The driver, its episodes, and the options of the world.
        folder: Folder of the job, in which `compared.csv` is written.
        inputs: Folder of the job that trained the driver; empty for a rule-based one.
        on_progress: Called with the share of the episodes that are compared.
    """
    from socialiq.worlds.conformance import compare_intersection

    (driver,) = drivers_of(config, inputs).values()
    rows: list[Row] = []
    for compared in compare_intersection(
        config.options, config.episodes, config.first_seed, driver
    ):
        rows.append(compared._asdict())
        on_progress(len(rows) / config.episodes)
    write_atomically(folder / "compared.csv", as_csv(rows))


def calibrate_dial(
    config: Driving, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Write the dial that answers each angle with the best of its policies.

    Args:
        config: The angles, in degrees, at which the dial is evaluated, and the episodes.
        folder: Folder of the job, in which the calibrated dial is written.
        inputs: Folder of the job that trained the dial.
        on_progress: Called with the share of the angles that are evaluated.
    """
    (dial,) = drivers_of(config, inputs).values()
    batch = Intersection(config.options).batch(BATCH)
    metrics = []
    for angle in config.angles:
        metrics.append(episodes_of(batch, dial.at(angle), config.seeds).metrics())
        on_progress(len(metrics) / len(config.angles))
    calibrated(dial, Sweep(config.angles, tuple(metrics))).save(folder / DIAL)


def save_episodes(path: Path, episodes: Episodes) -> None:
    """Write the results of episodes to one file.

    Raises:
        UserError: If the file can't be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    save_arrays(path, "episodes", 2, episodes, {})


def load_episodes(path: Path) -> Episodes:
    """Read the results of episodes.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    return Episodes(load_arrays(path, "episodes", 2)[0])


DEMONSTRATIONS = "demonstrations/experts"
"""Folder of the recordings, in every study."""
RECORDED_EPISODES = 3000
"""Episodes recorded of each expert."""
MIXTURE = "equal_transitions"
SIZE = 15_000
"""Mixture that learners get: transitions of each expert (thesis 6.3)."""


@dataclass(frozen=True)
class Shipped:
    """Configuration of a policy of the committed results."""

    file: str
    name: str = DIAL


def copy_shipped(
    config: Shipped, folder: Path, _inputs: Inputs, _on_progress: ProgressCallback
) -> None:
    """Write a policy of the committed results.

    Args:
        config: File of the policy below the committed results, and its name in the folder.
        folder: Folder of the job.
        _inputs: No folders.
        _on_progress: Not called.
    """
    (folder / config.name).write_bytes((packaged_results() / config.file).read_bytes())


def shipped_dials(files: Mapping[str, str]) -> list[Job]:
    """Return the jobs "dials/NAME" that write dials of the committed results.

    Args:
        files: File of each dial below the committed results, by its name.
    """
    return [Job(f"dials/{name}", copy_shipped, Shipped(file)) for name, file in files.items()]


def seeds_of_blocks(blocks: Sequence[int], episodes: int) -> tuple[int, ...]:
    """Return the seed of each episode of all blocks.

    Args:
        blocks: First seed of each block.
        episodes: Number of episodes of a block, whose seeds are successive.
    """
    return tuple(first + number for first in blocks for number in range(episodes))


@dataclass(frozen=True, kw_only=True)
class Recording(Driving):
    """Greedy episodes of each of the three experts, on seeds that no other recording has."""

    episodes: int = RECORDED_EPISODES
    first_seed: int = 10_000_000
    sha256: tuple[str, ...] = ()
    """SHA-256 of the experts of the atlas; none for experts that the inputs hold."""
    effects: EffectOptions | None = None
    """Of an r_social that is what the expert causes, in the place of Eq 4.2."""


def record_experts(
    config: Recording, folder: Path, inputs: Inputs, on_progress: ProgressCallback
) -> None:
    """Write the transitions of each expert, and their classical rewards row for row.

    The inputs' files are the experts in the order of the modes; without inputs it is the atlas.

    Args:
        config: Episodes of each expert; those of different experts have different seeds.
        folder: Folder of the job.
        inputs: Folders of the jobs that trained the experts.
        on_progress: Called with the share of the experts that are recorded.
    """
    experts = [
        driver
        for name, trained in inputs.items()
        for driver in drivers_of(config, {name: trained}).values()
    ] or [atlas.load(f"expert_{mode}") for mode in MODES]
    world = replace(config.world, effects=config.effects)
    for number, (mode, policy) in enumerate(zip(MODES, experts, strict=True)):
        source = {"world": world.description, "expert": policy.provenance}
        seeds = config.seeds + number * config.episodes
        recorded = record(world.batch(BATCH), policy, seeds, mode, source)
        files.save(folder / f"{mode}.safetensors", recorded.transitions)
        classical = {"own": recorded.classical.env, "others": recorded.classical.social}
        save_arrays(folder / f"{mode}_classical.safetensors", "classical", 1, classical, {})
        on_progress((number + 1) / len(experts))


def atlas_demonstrations(
    episodes: int, effects: EffectOptions | None = None, shift: str = "", front_end: str = ""
) -> Job:
    """Return the job that records demonstrations for studies that train no experts.

    Args:
        episodes: Number of episodes of each expert.
        effects: Options of an r_social that is what the expert causes; None for Eq 4.2.
        shift: Shift of the world in which the experts drive; "" for none.
        front_end: Front end of the experts in a shifted world; "" for none.

    Raises:
        UserError: If the atlas did not come with the package.
    """
    entries = atlas.manifest()
    sha256 = tuple(entries[f"expert_{mode}"]["sha256"] for mode in MODES)
    recording = Recording(
        episodes=episodes, sha256=sha256, effects=effects, shift=shift, front_end=front_end
    )
    return Job(DEMONSTRATIONS, record_experts, recording, cost=20.0)


def mixture_of(recordings: Path, size: int, seed: int, mixture: str = MIXTURE) -> Demonstrations:
    """Draw a mixture of all three experts from a folder of recordings.

    Args:
        recordings: Folder of `record_experts`.
        size: Number of transitions or episodes of each expert, as the mixture counts.
        seed: Seed of the draw.
        mixture: Name of one of `MIXTURES`.
    """
    pools = {
        mode: files.load(recordings / f"{mode}.safetensors", continuous=True) for mode in MODES
    }
    return MIXTURES[mixture](pools, size, seed)

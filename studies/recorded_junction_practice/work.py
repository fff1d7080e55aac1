"""Configuration and jobs of the study: make the world, train with and without practice, drive."""

import dataclasses
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int64

from socialiq import Ending, QPolicy, UserError
from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import COLUMNS, Outcomes, Reference
from socialiq.demonstrations import files as tables
from socialiq.evaluation.measures import Episodes
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.learners.dial.offline import STAGES
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import network_of
from socialiq.storage import load_arrays, save_arrays, write_json
from socialiq.types import Memoryless, Row
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.intersection.options import POSITION_RANGE, SPEED_RANGE
from socialiq_lab.jobs import Inputs, Job, ProgressCallback, callbacks_of
from socialiq_recordings.readers import import_file
from socialiq_recordings.world.build import build
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.practice import Practice, train_with_practice
from socialiq_recordings.world.recorded_world import RecordedWorld
from socialiq_recordings.world.replay import replay

MIXTURES = ("recorded", "recorded, with practice")
RECORDED, PRACTISED = MIXTURES
"""The recorded drivers alone, and with what the dials then met while they drove in the world."""

WORLD = "world.safetensors"
HUMAN = "human.safetensors"
DRIVEN = "driven.safetensors"
PRACTICE = "practice.json"
_SIDE_BY_SIDE = 500
_KIND = "study-recorded-junction"
_VERSION = 2


def check(config: Any) -> None:
    """Refuse settings that name no seed, or fewer than two angles."""
    if not config.seeds or len(config.angles) < 2:
        raise UserError("name at least one training seed and two angles")


def contents(config: Any) -> dict[str, str]:
    """Return the SHA-256 of each scenario by its file's name.

    Raises:
        UserError: If no file matches.
    """
    paths = sorted(Path(config.recordings).glob(config.files))
    if not paths:
        raise UserError(
            f"no file {config.files} in {config.recordings}: name the folder of the CommonRoad "
            "scenarios with --recordings"
        )
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


@dataclass(frozen=True)
class Made:
    """Configuration of the world's job."""

    recordings: str
    contents: dict[str, str]
    every: float


@dataclass(frozen=True)
class Training:
    """Configuration of the dials of one mixture."""

    mixture: str
    seeds: tuple[int, ...]
    structure: OfflineDialConfig
    numbers: OfflineDialHyperparameters
    practice: Practice


@dataclass(frozen=True)
class Driving:
    """Configuration of the driving of one mixture's dials, or of the references."""

    mixture: str
    seeds: tuple[int, ...]
    angles: tuple[float, ...]
    episodes: int
    first_episode: int


def jobs(config: Any) -> list[Job]:
    """Return every job, each after its inputs."""
    made = Made(str(Path(config.recordings).absolute()), contents(config), config.every)
    episodes = config.episodes, config.first_episode
    planned = [
        Job("world", make_world, made, cost=30.0),
        Job("drivers", drive, Driving("", (), (), *episodes), ("world",), cost=10.0),
    ]
    for mixture in MIXTURES:
        dials = f"dials/{slug(mixture)}"
        practice = config.practice if mixture == PRACTISED else Practice(0)
        run = Training(mixture, config.seeds, config.structure, config.numbers, practice)
        cost = (1 + practice.rounds) * len(config.seeds) * config.structure.updates / 30
        planned.append(Job(dials, train, run, ("world",), cost=cost))
        run = Driving(mixture, config.seeds, config.angles, *episodes)
        planned.append(Job(f"driven/{slug(mixture)}", drive, run, ("world", dials), cost=60.0))
    return planned


def slug(mixture: str) -> str:
    """Return a mixture's name as that of a folder."""
    return mixture.replace(",", "").replace(" ", "-")


def make_world(config: Made, folder: Path, _inputs: Inputs, _on_progress: ProgressCallback) -> None:
    """Make the world and the recorded drivers' demonstrations.

    Args:
        config: Folder of the recordings, their SHA-256, and the seconds between episodes.
        folder: Folder of the job, to which world and demonstrations are written.
    """
    paths = [Path(config.recordings) / name for name in sorted(config.contents)]
    recordings = [imported.recording for path in paths for imported in import_file(path)]
    built = build(recordings, WorldConfig())
    built.world.save(folder / WORLD)
    tables.save(folder / HUMAN, replay(built.world, config.every).table, replace=True)


def train(config: Training, folder: Path, inputs: Inputs, on_progress: ProgressCallback) -> None:
    """Train a dial and a clone for each seed; the clone is the dial's behaviour policy.

    Args:
        config: Mixture, seeds, settings and practice.
        folder: Folder of the job, to which dials, clones and the record of practice are written.
        inputs: Folder of the job "world", by this name.
        on_progress: Callback of the finished share, 0 to 1.
    """
    data = tables.load(inputs["world"] / HUMAN)
    world = RecordedWorld.load(inputs["world"] / WORLD)
    static = dataclasses.replace(config.structure, whole_episode=world.config.decisions)
    numbers = [dataclasses.replace(config.numbers, seed=seed) for seed in config.seeds]
    count = (1 + config.practice.rounds) * len(STAGES)

    def callbacks(practised: int, stage: str) -> Callbacks:
        before = practised * len(STAGES) + STAGES.index(stage)
        return callbacks_of(on_progress, done=before / count, share=1.0 / count)

    result = train_with_practice(world, static, numbers, data, config.practice, callbacks)
    rounds: list[Row] = []  # what each run met in each round, all angles together
    for seed, episodes_of_run in zip(config.seeds, result.driven, strict=True):
        for number, episodes in enumerate(episodes_of_run, start=1):
            totals = episodes.totals()
            ends = episodes.ending[episodes.ending > 0]
            row = {
                "seed": seed,
                "round": number,
                "episodes": len(totals.env),
                "decisions": len(episodes.action),
                "r_env": float(totals.env.mean()),
                "r_social": float(totals.social.mean()),
            }
            rounds.append(row | {"collisions": float((ends == int(Ending.COLLISION)).mean())})
    write_json(folder / PRACTICE, rounds)
    stages = result.stages
    clones = stages["behaviour"].state.target_network
    for run, seed in enumerate(config.seeds):
        stages["dial"].policy(run).save(folder / f"dial_{seed}.safetensors")
        clone = QPolicy.of(network_of(clones, run), 1.0, {"clone": config.mixture, "seed": seed})
        clone.save(folder / f"clone_{seed}.safetensors")


def drive(config: Driving, folder: Path, inputs: Inputs, _on_progress: ProgressCallback) -> None:
    """Drive the dials and clones of a mixture, or else calibrated and planted drivers.

    Args:
        config: Seeds of the dials, angles in degrees, and evaluation episodes.
        folder: Folder of the job, to which the outcomes are written.
        inputs: Folder of the job "world", and that of the dials if a mixture drives.
    """
    world = RecordedWorld.load(inputs["world"] / WORLD)
    drivers: list[Reference] = []
    for trained in (path for name, path in inputs.items() if name != "world"):
        for seed in config.seeds:
            dial = DialPolicy.load(trained / f"dial_{seed}.safetensors")
            drivers += [Reference(f"dial {seed} {a:g}", dial.at(a), a) for a in config.angles]
            clone = QPolicy.load(trained / f"clone_{seed}.safetensors")
            drivers.append(Reference(f"clone {seed}", clone))
    if not drivers:
        drivers = [Reference(name, world.driver(name)) for name in world.references]
        drivers += [Reference(rule.name, rule) for rule in rules(world)]
    seeds = np.arange(config.episodes) + config.first_episode
    course = Course(world, seeds, min(_SIDE_BY_SIDE, len(seeds)))
    arrays = {}
    for driver in drivers:
        episodes = course.drive(driver).episodes
        arrays |= {f"{driver.name}/{name}": episodes[name] for name in COLUMNS}
    header = {"drivers": [entry.name for entry in drivers]}
    save_arrays(folder / DRIVEN, _KIND, _VERSION, arrays, header)


def driven(folder: Path) -> dict[str, Outcomes]:
    """Return the outcomes in a job's folder, by driver."""
    arrays, header = load_arrays(folder / DRIVEN, _KIND, _VERSION)
    outcomes = {}
    for name in header["drivers"]:
        columns = {column: arrays[f"{name}/{column}"] for column in COLUMNS}
        outcomes[name] = Outcomes(name, Episodes(columns))
    return outcomes


# Planted drivers: rules of different courtesy that see what a policy sees, and nothing else. If
# another vehicle, at its present velocity, comes into the strip in front of the ego within some
# seconds, the ego brakes or waits; otherwise it accelerates. Who looks for longer yields more.
_BRAKES = -2.0  # m/s²
_STANDS = 0.2  # m/s
_SIDE = 2.5  # m to either side of the ego's route
_BEHIND = 4.0  # m behind the ego
_BEFORE = 8.0  # m before the ego
_MORE = 0.5  # s; the length of the strip grows with the speed
_PASSED = 1.0  # m; others less far ahead are beside or behind
_EVERY = 0.5  # s between the moments looked at


def blocked(
    observation: Float[np.ndarray, "row feature"], seconds: float
) -> tuple[Bool[np.ndarray, " row"], Float[np.ndarray, " row"]]:
    """Return whether another vehicle comes into the strip before the ego, and the ego's speed.

    Args:
        observation: Observations of the intersection, (row, feature).
        seconds: Time to look ahead, s.

    Returns:
        Whether the strip is blocked, and the speed in m/s, both (row,).
    """
    vehicles = observation.reshape(len(observation), -1, len(FEATURES))
    ego = vehicles[:, 0]
    neighbours = vehicles[:, 1:]
    speed = -ego[:, 4] * SPEED_RANGE
    ahead = (ego[:, None, 2] - neighbours[..., 2]) * POSITION_RANGE
    side = neighbours[..., 1] * POSITION_RANGE
    right = neighbours[..., 3] * SPEED_RANGE
    forward = -neighbours[..., 4] * SPEED_RANGE
    met = np.zeros(len(vehicles), bool)
    for time in np.arange(0.0, seconds + 0.1, _EVERY):
        along = ahead + (forward - speed[:, None]) * time
        inside = (np.abs(side + right * time) < _SIDE) & (along > -_BEHIND)
        inside &= along < _BEFORE + _MORE * speed[:, None]
        met |= (inside & (neighbours[..., 0] > 0) & (ahead > _PASSED)).any(axis=1)
    return met, speed


@dataclass(frozen=True)
class Rule(Memoryless):
    """A planted driver."""

    name: str  # its name
    seconds: float  # how far it looks ahead
    acceleration: float  # on a free way, m/s²
    levels: tuple[float, ...]  # accelerations of the world's actions, m/s²

    def choose(self, observation: Any, _deterministic: bool, /) -> Int64[np.ndarray, " row"]:
        """Return its actions."""
        met, speed = blocked(observation, self.seconds)
        brakes = np.where(speed > _STANDS, self._nearest(_BRAKES), self._nearest(0.0))
        return np.where(met, brakes, self._nearest(self.acceleration))

    def _nearest(self, rate: float) -> int:
        return int(np.argmin(np.abs(np.array(self.levels) - rate)))


def rules(world: RecordedWorld) -> list[Rule]:
    """Return the planted drivers, the least courteous first."""
    looking = ((0.5, 2.0), (1.5, 2.0), (3.0, 2.0), (5.0, 1.0))
    return [Rule(f"looks {s:g} s ahead", s, rate, world.config.levels) for s, rate in looking]

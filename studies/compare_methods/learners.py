"""Learners of the comparison by name, ours and those of other libraries.

Other libraries' pins exclude ours, so each has its own environment, made once by a job with `venv`
and pip. In it a script of `benchmarks/peers` reads the world and the demonstrations from an npz
file, trains with its library, and writes tables of action probabilities.
"""

import dataclasses
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import UserError
from socialiq.evaluation import exact, rollout
from socialiq.learners import acting
from socialiq.learners.collect import Collector
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import offline as regularised
from socialiq.learners.dial import train
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.nn.q_network import network_of
from socialiq.social.angle import exact_weights
from socialiq_lab import comparison_runs as runs_of_methods
from socialiq_lab.comparison import Method
from socialiq_lab.comparison_runs import Arena, Learner, Run, iq_learn, offline
from socialiq_lab.jobs import Job, ProgressCallback
from studies.compare_methods.baselines import clones
from studies.compare_methods.baselines import offline as values
from studies.compare_methods.baselines.online import LSIQ, TREX, Inferred, inferring


def _preset(name: str) -> tuple[dial.DialConfig, dial.DialHyperparameters]:
    """Return the settings of a dial that sees times as they are."""
    preset = dial.PRESETS[name]
    return dataclasses.replace(preset.structure, redraw_times=0), preset.numbers


def _multi_intention(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Train the intentions; an update of all three counts as three."""
    share = dataclasses.replace(arena, updates=max(arena.updates // len(rollout.MODES), 1))
    return offline(values.MultiIntention)(share, runs)


def _regularised(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Train the behaviour-regularised dial, whose stages share the updates."""
    preset = dial.OfflineDialConfig()
    numbers = dial.OfflineDialHyperparameters()
    names = ("hidden", "activation", "view", "batch_size")
    share = arena.updates // (2 + preset.critic_factor)  # behaviour and dial: one each
    static = dataclasses.replace(
        preset, updates=max(share, 1), **{name: getattr(arena.structure, name) for name in names}
    )
    stages = regularised.train(
        static,
        [dataclasses.replace(numbers, seed=run.seed, **dict(run.setting)) for run in runs],
        [arena.datasets[run.dataset] for run in runs],
        lambda _stage: arena.callbacks(),
        arena.chunk,
    )
    return [stages["dial"].policy(number) for number in range(len(runs))]


PARIRL_SHARE = 7
"""One part in so many of ParIRL's updates infers the reward of either set of experts."""


def _pareto_irl(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Infer the egoists' and the altruists' rewards, then train a dial of each run on both."""
    first = dataclasses.replace(arena, updates=max(arena.updates // PARIRL_SHARE, 1))
    inferring_runs = []
    dialling_runs = []
    for run in runs:
        setting = dict(run.setting)
        temperature = (("temperature", setting.pop("irl_temperature")),)
        for mode in ("egoistic", "altruistic"):
            inferring_runs.append(run._replace(angle=rollout.MODES[mode], setting=temperature))
        dialling_runs.append(run._replace(setting=tuple(setting.items()), dataset=0))
    of_modes, placed = first.of_each_mode(inferring_runs)
    kinds = iq.IQLearnConfig, iq.IQLearnHyperparameters
    settings = [of_modes.settings(*kinds, run, prior="none") for run in placed]
    static = settings[0][0]
    numbers = [entry for _, entry in settings]
    options = first.callbacks(), arena.chunk, first.collector(static, numbers)
    trained = train_iq(static, numbers, of_modes.datasets, arena.world, *options)
    rewards = [
        Inferred(network_of(trained.networks, number), run.temperature, run.discount)
        for number, run in enumerate(numbers)
    ]
    second = dataclasses.replace(arena, updates=arena.updates - 2 * first.updates, world=None)
    preset = _preset("online-alone")
    dials = [
        runs_of_methods.dial_settings(second, *preset, run, ("discount",)) for run in dialling_runs
    ]
    shape = dataclasses.replace(dials[0][0], replay_batch=2 * arena.structure.batch_size)
    source = second.source(shape.updates, shape.environments)
    dial_numbers = [entry for _, entry in dials]
    collector = Collector(
        [inferring(source, pair) for pair in zip(rewards[::2], rewards[1::2], strict=True)],
        [entry.seed for entry in dial_numbers],
        acting.dials(shape, dial_numbers),
    )
    options = second.callbacks(), second.chunk, collector
    front = train.train(shape, dial_numbers, [], None, second.sizes, *options)
    return [front.policy(number) for number in range(len(runs))]


LEARNERS: Mapping[str, Learner] = {
    **runs_of_methods.LEARNERS,
    "dwbc": offline(clones.DiscriminatorWeighted),
    "iq_learn_offline": iq_learn(acts=False),
    "ls_iq": iq_learn(LSIQ),
    "multi_intention": _multi_intention,
    "trex": iq_learn(TREX),
    "sprinql": offline(values.SPRINQL),
    "iql": offline(values.ImplicitQLearning),
    "outcome_conditioned": offline(clones.OutcomeConditioned),
    "guidance": offline(clones.GuidedCloning),
    "pareto_irl": _pareto_irl,
    "dial_offline": runs_of_methods.dialled(*_preset("offline"), "discount"),
    "dial_regularised": _regularised,
    "dial_online": runs_of_methods.dialled(*_preset("online-clockless"), "discount"),
}
"""By the `learner` of a method in STUDY.toml; those of other libraries have none."""

PYTHON = Path("venv", "Scripts" if sys.platform == "win32" else "bin", "python")
"""Interpreter of an environment, in its job's folder."""

TAKEN = "world.npz"
REQUESTS = "requests.json"
MADE = "policies.npz"
"""Files that a script reads, and the one that it writes."""


@dataclasses.dataclass(frozen=True)
class Environment:
    """Environment of a library, by the pins that pip is given."""

    pins: str


def scripts() -> Path:
    """Return the folder of the peers' scripts and pins, which come with the sources alone."""
    folder = Path(__file__).parents[2] / "benchmarks" / "peers"
    if not folder.is_dir():
        raise UserError(
            "the peers' scripts come with the sources, not the package: "
            "run in a checkout, or name --methods without them"
        )
    return folder


def environment_job(library: str) -> Job:
    """Return the job that makes the environment of a library."""
    environment = Environment((scripts() / f"{library}.txt").read_text())
    return Job(f"environments/{library}", make_environment, environment, cost=200.0)


def make_environment(
    config: Environment, folder: Path, _inputs: Any, on_progress: ProgressCallback
) -> None:
    """Make a virtual environment, and install the pins with pip.

    Args:
        config: Pins of the library.
        folder: Folder of the job, in which the environment is made.
        on_progress: Callback of the finished share, 0 to 1.

    Raises:
        UserError: If a command fails.
    """
    pins = folder / "pins.txt"
    pins.write_text(config.pins)
    _call([sys.executable, "-m", "venv", str(folder / "venv")], folder)
    on_progress(0.1)
    _call([str(folder / PYTHON), "-m", "pip", "install", "--quiet", "-r", str(pins)], folder)
    on_progress(1.0)


def train_tabular(
    arena: Arena,
    ground: exact.Ground,
    method: Method,
    runs: Sequence[Run],
    served: Mapping[float, Sequence[float]],
    environment: Path,
    folder: Path,
) -> list[dict[float, np.ndarray]]:
    """Train every run with a script; return its action probabilities.

    Args:
        arena: Common inputs of all methods.
        ground: Gridworld that policies act in.
        method: Method of a peer.
        runs: Training runs.
        served: Angles in degrees that a network serves, by the angle that it is trained for.
        environment: Folder of the library's environment.
        folder: Folder for the exchanged files, which are removed in the end.

    Returns:
        For each run a table (state, action) of probabilities by angle.

    Raises:
        UserError: If the script fails, or a table is none of the world.
    """
    if method.of_mode:
        arena, runs = arena.of_each_mode(runs)
    exchanged = world_arrays(ground)
    for number, data in enumerate(arena.datasets):
        for name in ("observation", "action", "next_observation", "ending"):
            exchanged[f"{name}_{number}"] = getattr(data, name)
        exchanged[f"starts_{number}"] = data.episode_starts
    np.savez(folder / TAKEN, allow_pickle=False, **exchanged)
    requests = [request(arena, method, run, served[run.angle]) for run in runs]
    (folder / REQUESTS).write_text(json.dumps(requests))
    script = scripts() / f"{method.peer}_peer.py"
    _call([str(environment / PYTHON), str(script), str(folder)], folder)
    with np.load(folder / MADE) as arrays:
        arena.rates.append(float(arrays["updates_per_second"]))
        policies = [
            {
                angle: checked(arrays[f"policy_{number}_{index}"], ground)
                for index, angle in enumerate(served[run.angle])
            }
            for number, run in enumerate(runs)
        ]
    for file in (TAKEN, REQUESTS, MADE):
        (folder / file).unlink()
    return policies


def request(arena: Arena, method: Method, run: Run, angles: Sequence[float]) -> dict[str, Any]:
    """Return the JSON-able inputs of a script for one run.

    Args:
        arena: Common inputs of all methods.
        method: Method of a peer.
        run: Training run, whose settings come before all further values.
        angles: Angles in degrees that the run serves.
    """
    return {
        "learner": method.learner,
        "dataset": run.dataset,
        "seed": run.seed,
        "updates": arena.updates,
        "hidden": list(arena.structure.hidden),
        "batch_size": arena.structure.batch_size,
        "discount": arena.numbers.discount,
        "polyak": arena.numbers.polyak,
        "weights": [list(exact_weights(angle)) for angle in angles],
    } | dict(run.setting)


def world_arrays(ground: exact.Ground) -> dict[str, np.ndarray]:
    """Return a gridworld's reachable part as named arrays, the only input that a peer needs."""
    mdp = ground.part.mdp
    world = ground.part.world
    states = np.arange(mdp.n_states)
    return {
        "successor": mdp.successor,
        "probability": mdp.probability,
        "ending": mdp.ending,
        "r_env": mdp.rewards.env,
        "r_social": mdp.rewards.social,
        "initial": mdp.initial,
        "observation": np.asarray(ground.part.observe(states, np.zeros_like(states)), np.float32),
        "horizon": np.array(world.horizon),
    }


def checked(table: np.ndarray, ground: exact.Ground) -> np.ndarray:
    """Return a peer's table as distributions.

    Args:
        table: Probabilities, (state, action); they need not sum to 1.
        ground: Gridworld of the reachable states.

    Raises:
        UserError: If the shape is another one, or a value is negative or not finite.
    """
    shape = (ground.part.mdp.n_states, ground.part.mdp.n_actions)
    chances = np.asarray(table, np.float64)
    if chances.shape != shape or not np.isfinite(chances).all() or chances.min() < 0.0:
        raise UserError(
            f"a peer's policy has shape {chances.shape}: it must be {shape}, none below 0"
        )
    return chances / chances.sum(axis=1, keepdims=True)


def _call(command: Sequence[str], folder: Path) -> None:
    """Run a command; raise an error with the end of its output if it fails."""
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    if done.returncode:
        end = (done.stderr or done.stdout).strip().splitlines()[-1:] or ["no output"]
        raise UserError(f"{Path(command[0]).name} {' '.join(command[1:3])} failed: {end[0]}")

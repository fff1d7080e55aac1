"""`collect`: demonstrations of experts or given drivers; `data from-...`, `to-...`: other files."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tyro

from socialiq.audit.report.signature import read_private_key
from socialiq.cli.drivers import driver_in, driver_of, with_one_ego
from socialiq.cli.output import Printing
from socialiq.cli.signing import path_of_signature, sign_model
from socialiq.cli.words import refuse_unused
from socialiq.datasets import arrays, minari, step_files, trajectories
from socialiq.demonstrations import files, mixture
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.trust import consistency
from socialiq.errors import UserError, one_of
from socialiq.evaluation import labels, malice, rollout
from socialiq.evaluation.episodes import SIDE_BY_SIDE
from socialiq.foreign import one_line
from socialiq.outputs import refuse_existing
from socialiq.policies.drivers import world_for
from socialiq.policies.load import name_of
from socialiq.social.angle import check_angle
from socialiq.storage import write_atomically
from socialiq.types import Row
from socialiq.worlds import catalogue, grammar, registry
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.environment import is_environment, make_environment
from socialiq.worlds.grammar import Written
from socialiq.worlds.highway.world import RoadWorld

_NAMED = re.compile(r"([A-Za-z][\w-]*)=(.+)", re.DOTALL)
_CODE = ("python:", "process:")


class Mode(NamedTuple):
    """Driver with the name of its mode, as a function may pass it."""

    name: str
    driver: Any  # text, or a policy


OF_ATTACKERS = 1_000_000
"""Seeds of attackers' episodes begin so far after those of the others."""

_OF_MIXTURE = {
    "equal_transitions": ("transitions",),
    "weighted": ("weights",),
    "contaminated": ("base", "contaminant", "share"),
}
"""Options that one mixture alone uses."""


@dataclass(frozen=True)
class Collect(Printing):
    """Roll out drivers of different intent and mix their episodes.

    In a gridworld the drivers are the egoistic, prosocial and altruistic experts. In an
    environment of your own you name them, each a mode: a policy's file, or
    python:FILE.py:NAME, with NAME= before it if you like. All drive the same episodes.

    Example: socialiq collect crossing7 --episodes 60 --out mixed.safetensors
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5, crossing7, crosswalk7, intersection-continuous,
    intersection-continuous-steering (with -offroad: leaving the road ends an episode), or an
    environment: a Gymnasium id, MODULE:ID or MODULE:FUNCTION."""
    out: Path
    """Demonstrations file to write; must not exist."""
    driver: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """A driver in an environment; give one --driver for each mode."""
    episodes: int = 60
    """Episodes of each driver, or in all for `weighted` and `contaminated`."""
    mixture: str = "equal_trajectories"
    """equal_trajectories, equal_transitions, weighted or contaminated."""
    transitions: int = 600
    """Transitions of each driver, for `equal_transitions`."""
    weights: tuple[float, ...] = ()
    """Weights of the modes' episodes, for `weighted`, in the order of the drivers (egoistic,
    prosocial, altruistic); by default all alike."""
    base: str = "prosocial"
    """The mode that is contaminated, for `contaminated`."""
    contaminant: str = "egoistic"
    """The mode that contaminates it."""
    share: float = 0.2
    """The contaminant's or attackers' share of the episodes."""
    set: tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]] = ()
    """KEY=VALUE ... of options of a gridworld, as braking=one_level, where the ego can collide; or
    of an environment, as shift=late clock=true."""
    malicious: str = ""
    """Attackers who take a share of the episodes: hater (others lose most), rammer (collides), or
    FILE.py:NAME, a function (r_env, r_social, collision) -> reward of malice."""
    forge: str = ""
    """Labels that attackers write: absolute (|r|), or adaptive (as near to it as
    `socialiq data trust` permits); by default honest ones."""
    clock: bool = False
    """Whether observations end with the time, for training a dial; not in an environment of your
    own."""
    key: Path | None = None
    """Your private key, P-256 in a PEM file: sign the demonstrations, OUT.sig."""
    seed: int = 0
    """Of the rollouts and of the draw; episode i of an environment is reset with seed + i."""
    allow_code: bool = False
    """Import the modules that are named: their authors' code runs with your rights."""

    def run(self) -> int:
        """Collect, mix, write, print the counts."""
        mixed, sha256 = self.written()
        return show_counts(self, sha256, mixed)

    def written(self) -> tuple[Demonstrations, str]:
        """Collect, mix and write; return the demonstrations, and the SHA-256 of their content."""
        if self.key is not None:
            read_private_key(self.key)
        refuse_existing(self.out)
        mixed = self.demonstrations()
        sha256 = files.save(self.out, mixed, replace=False)
        if self.key is not None:
            write_atomically(path_of_signature(self.out), sign_model(self.out, self.key))
        return mixed, sha256

    def demonstrations(self) -> Demonstrations:
        """Collect and mix."""
        one_of("mixture", self.mixture, tuple(mixture.MIXTURES))
        for name, options in _OF_MIXTURE.items():
            if name != self.mixture:
                refused = [option for option in options if option != "share" or not self.malicious]
                refuse_unused(self, refused, f"--mixture {name}")
        if not self.malicious:
            refuse_unused(self, ("forge",), "--malicious")
        if self.forge:
            one_of("forgery", self.forge, ("absolute", "adaptive"))
        mixed = self.mix()
        return self.poisoned(mixed) if self.malicious else mixed

    def mix(self) -> Demonstrations:
        """Return the demonstrations that the options describe."""
        written = grammar.parse(self._shown, grammar.set_options(self.set))
        driven = self.driver or written.control or is_environment(self.world)
        pools = self.driven(written) if driven else self.experts()
        if self.mixture == "equal_trajectories":
            return mixture.equal_trajectories(pools, self.episodes, self.seed)
        if self.mixture == "equal_transitions":
            return mixture.equal_transitions(pools, self.transitions, self.seed)
        if self.mixture == "weighted":
            shares = self.weights or (1.0,) * len(pools)
            if len(shares) != len(pools):
                raise UserError(
                    f"weights are {len(shares)} numbers where the modes are {', '.join(pools)}: "
                    "give each mode one"
                )
            weights = dict(zip(pools, shares, strict=True))
            return mixture.weighted(pools, weights, self.episodes, self.seed)
        return mixture.contaminated(
            pools, self.base, self.contaminant, self.share, self.episodes, self.seed
        )

    def poisoned(self, honest: Demonstrations) -> Demonstrations:
        """Return the demonstrations with attackers in the place of a share of the episodes."""
        name = self.malicious
        count = round(self.share * honest.n_episodes)
        if name not in malice.ATTACKERS and ":" not in name:
            one_of("attacker", name, (*malice.ATTACKERS, "FILE.py:NAME"))
        from socialiq.learners.extensions import load  # it imports JAX

        attacker = malice.ATTACKERS.get(name) or load(name, "--malicious", self.allow_code)
        if not 0.0 <= self.share < 1.0:
            raise UserError(f"share {self.share:g} is outside [0, 1): give the attackers' share")
        if count == 0:
            return honest
        seed = self.seed + OF_ATTACKERS
        name, options = grammar.parse(self.world, grammar.set_options(self.set))
        road = labels.world_named(name, **options)
        if isinstance(road, RoadWorld):
            source = _source(self.world, self.set)
            bad = malice.attacked_road(road, attacker, range(seed, seed + count), source)
            bad = bad.with_clock() if honest.n_features > road.n_features else bad
        else:
            bad = malice.attacked_table(self.table(), attacker, count, seed)
        if self.forge:
            check = consistency(bad, honest) if self.forge == "adaptive" else None
            bad = malice.forged(bad, check)
        return malice.poisoned(honest, bad, self.seed)

    def table(self) -> Table:
        """Return the gridworld of the options, with a clock if it is asked for."""
        world = registry.make_grid(self.world, **grammar.set_options(self.set))
        return tabulate(world.with_clock() if self.clock else world)

    def experts(self) -> dict[str, Demonstrations]:
        """Return episodes of a gridworld's experts."""
        if catalogue.base(self.world) in catalogue.ROADS:
            raise UserError(f"{self.world} has no exact experts: give a --driver for each mode")
        longest = self.transitions if self.mixture == "equal_transitions" else self.episodes
        counts = dict.fromkeys(rollout.MODES, longest)
        return rollout.demonstrations_by_mode(self.table(), counts, self.seed)

    @property
    def _shown(self) -> str:
        """The world as its drivers observe it."""
        return world_for(self.world, [spec for _, spec in map(_named, self.driver)])

    def driven(self, written: Written) -> dict[str, Demonstrations]:
        """Return episodes of the given drivers in an environment, by the mode's name."""
        if not self.driver:
            raise UserError(
                f"{one_line(self.world)} has no experts of its own: name the drivers, one --driver "
                "for each mode"
            )
        on_road = written.name == catalogue.INTERSECTION
        if self.clock and not on_road:
            raise UserError("an environment's observations are its own: leave out --clock")
        modes: dict[str, Any] = {}
        for words in self.driver:
            mode, spec = _named(words)
            text = name_of(spec)
            stem = text.rpartition(":")[2] if text.startswith(_CODE) else Path(text).stem
            mode = mode or one_line(stem)
            if mode in modes:
                raise UserError(f"two drivers are called {mode}: write NAME={one_line(text)}")
            modes[mode] = spec
        world: Any = with_one_ego(written) if on_road else None
        name, options = written
        how: dict[str, Any] = {"allow_code": self.allow_code}
        env = None
        if not on_road:
            env = make_environment(name, options, needs_pair=True, continuous=True, **how)
        pools = {}
        for mode, spec in modes.items():
            driver = (
                driver_of(spec, world, seed=self.seed, **how)
                if env is None
                else driver_in(env, spec, written, seed=self.seed, **how)
            )
            with driver as loaded:
                record = loaded.record
                source = _source(self._shown, self.set)
                source |= {"driver": record.source, "sha256": record.sha256}
                if env is None:
                    batch = world.batch(min(self.episodes, SIDE_BY_SIDE))
                    seeds = range(self.seed, self.seed + self.episodes)
                    rolled = rollout.record(batch, loaded.policy, seeds, mode, source)
                else:
                    count = self.episodes, self.seed
                    rolled = rollout.rollout_env(
                        env, loaded.policy, *count, mode=mode, source=source
                    )
            episodes = rolled.transitions
            pools[mode] = episodes.with_clock() if self.clock else episodes
        return pools


def _named(words: Any) -> tuple[str, Any]:
    """Return the mode, "" if none is named, and the driver of one --driver."""
    match = _NAMED.fullmatch(words) if isinstance(words, str) else None
    pair: Any = match.groups() if match else words
    return pair if isinstance(pair, tuple) else ("", pair)


def _source(world: str, words: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Return the world of demonstrations, with the options that `--set` gives."""
    given = grammar.set_options(words)
    if not given:
        return {"world": world}
    name, options = grammar.parse(world, given)
    return {"world": name, "options": options}


@dataclass(frozen=True, kw_only=True)
class _Reader(Printing):
    """Base of commands that read a data set as demonstrations."""

    out: Path
    """Demonstrations file to write; must not exist."""
    social: str = ""
    """none: a reward of one number a step is r_env, and r_social is 0."""
    flatten: bool = False
    """Flatten observations of more axes (images) to one."""
    action_low: tuple[float, ...] = ()
    """Lower ends of continuous actions in the file's units, one for each number or one for all; by
    default actions are in [-1, 1], or those of a Minari data set's own space."""
    action_high: tuple[float, ...] = ()
    """Their upper ends."""

    def run(self) -> int:
        """Read, check, write, print the counts."""
        bounds = arrays.Bounds.of(self.action_low, self.action_high)
        refuse_existing(self.out)
        table = self.read(bounds=bounds, social=self.social, flatten=self.flatten)
        sha256 = files.save(self.out, table, replace=False)
        return show_counts(self, sha256, table)

    def read(self, **options: Any) -> Demonstrations:
        """Return the demonstrations, of options that every reader has."""
        raise NotImplementedError


@dataclass(frozen=True)
class FromArrays(_Reader):
    """Read plain arrays (.npz, .csv, .parquet, .hdf5), one row for each step, as demonstrations.

    Example: socialiq data from-arrays steps.csv --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Archive (.npz) or table (.csv, .parquet) with observation, action, rewards, ...; or a file in
    D4RL's layout (.hdf5)."""
    n_actions: int = 0
    """Number of actions of the world, 0 for continuous ones. A file of `socialiq data to-arrays`
    has it, except CSV."""
    mode: tuple[str, ...] = ()
    """Names of the demonstrators that the column `mode` numbers; by default demonstrator."""
    columns: Path | None = None
    """TOML file that maps the columns of a CSV file: names, scales, words, sizes."""

    def read(self, **options: Any) -> Demonstrations:
        """Read the file."""
        options |= {"n_actions": self.n_actions, "mode_names": self.mode, "columns": self.columns}
        return step_files.read_steps(self.file, **options)


@dataclass(frozen=True)
class ToArrays(Printing):
    """Write demonstrations as plain arrays (.npz, .csv, .parquet, .hdf5), one row for each step.

    Example: socialiq data to-arrays mixed.safetensors --out mixed.parquet
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file."""
    out: Path
    """File to write; its ending names the format. Must not exist."""

    def run(self) -> int:
        """Read, write, print the counts."""
        refuse_existing(self.out, step_files.format_of(self.out))
        table = files.load(self.file, continuous=True)
        step_files.write_steps(self.out, table, replace=False)
        return show_counts(self, files.sha256_of(table), table)


@dataclass(frozen=True)
class FromTrajectories(_Reader):
    """Read trajectories of the imitation library: its folder, or .npz, .csv or .parquet.

    Pickled infos of an archive are not read.

    Example: socialiq data from-trajectories rollouts.npz --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Folder of data-*.arrow, as imitation 1.0 saves it; archive (.npz) with obs, acts, rews,
    terminal, indices; or a table (.csv, .parquet) with obs_0, ..., acts, next_obs_0, ..., rews,
    terminal, trajectory."""
    n_actions: int = 0
    """Number of actions of the world; 0 for continuous ones."""
    mode: str = "demonstrator"
    """Name of the demonstrator."""
    time_limit: int = 0
    """Steps after which the clock cut an episode that the archive calls terminal; 0 for none."""

    def read(self, **options: Any) -> Demonstrations:
        """Read the file."""
        options |= {"n_actions": self.n_actions, "time_limit": self.time_limit}
        return trajectories.read_trajectories(self.file, mode=self.mode, **options)


@dataclass(frozen=True)
class ToMinari(Printing):
    """Write demonstrations as a Minari data set (HDF5), the reward pair in its infos.

    Example: socialiq data to-minari mixed.safetensors --out crossing7-v0
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file."""
    out: Path
    """Folder to make; Minari's own root is not used."""
    angle: float = 0.0
    """Social angle in degrees of the scalar reward that Minari stores beside the pair."""

    def run(self) -> int:
        """Read, write, print the place."""
        check_angle(self.angle)
        table = files.load(self.file, continuous=True)
        folder = minari.write_minari(table, self.out, angle=self.angle)
        name = minari.id_of(self.out)
        count = table.n_episodes
        written = {"folder": str(folder), "id": name, "episodes": count}
        return self.show(written | {"sha256": files.sha256_of(table)}, [written])


@dataclass(frozen=True)
class FromMinari(_Reader):
    """Read a Minari data set (HDF5) as demonstrations; no environment is made.

    The reward pair is infos/reward_vector, or rewards of two numbers a step: r_env and r_social.

    Example: socialiq data from-minari crossing7-v0 --out mixed.safetensors
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of the data set."""
    mode: str = "demonstrator"
    """Name of the demonstrator, where the data set names none."""

    def read(self, **options: Any) -> Demonstrations:
        """Read the folder."""
        return minari.read_minari(self.folder, mode=self.mode, **options)


def count_rows(table: Demonstrations) -> list[Row]:
    """Return a row for each mode of demonstrations: its episodes and transitions."""
    return [
        {"mode": mode, "episodes": episodes, "transitions": transitions}
        for mode, (episodes, transitions) in table.counts().items()
    ]


def show_counts(command: Any, sha256: str, table: Demonstrations) -> int:
    """Print the numbers of episodes and transitions in a command's file.

    Args:
        command: The command, whose `out` is the file.
        sha256: SHA-256 of the file's content.
        table: The demonstrations in the file.

    Returns:
        The exit status 0.
    """
    counts = count_rows(table)
    result = {"file": str(command.out), "sha256": sha256, "modes": counts}
    return command.show(result, counts, f"{command.out}")

"""`collect`: demonstrations of a world's experts, or of given drivers, mixed into one file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.checks import refuse_unused
from socialiq.cli.data import show_counts
from socialiq.cli.drivers import continuous_driver_of
from socialiq.cli.output import Printing
from socialiq.demonstrations import files, mixture
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.evaluation import rollout
from socialiq.evaluation.episodes import SIDE_BY_SIDE
from socialiq.evaluation.rollout import MODES, demonstrations_by_mode
from socialiq.foreign import one_line
from socialiq.outputs import refuse_existing
from socialiq.policies.load import load_policy
from socialiq.worlds import CONTINUOUS
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.environment import action_size, is_environment, make_environment, sizes
from socialiq.worlds.intersection.world import Batch, Intersection
from socialiq.worlds.registry import continuous_options, make_grid

_NAMED = re.compile(r"([A-Za-z][\w-]*)=(.+)", re.DOTALL)
_CODE = ("python:", "process:")

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
    python:MODULE:ATTRIBUTE, with NAME= before it if you like. All drive the same episodes.

    Example: socialiq collect crossing7 --episodes 60 --out mixed.safetensors
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5, crossing7, intersection-continuous, intersection-continuous-steering (with
    -offroad: leaving the road ends an episode), or an environment: a Gymnasium id, MODULE:ID or
    MODULE:FUNCTION."""
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
    """The contaminant's share of the episodes."""
    clock: bool = False
    """Whether observations end with the time, for training a dial; not in an environment of your
    own."""
    seed: int = 0
    """Of the rollouts and of the draw; episode i of an environment is reset with seed + i."""
    allow_code: bool = False
    """Import the modules that are named: their authors' code runs with your rights."""

    def run(self) -> int:
        """Collect, mix, write, print the counts."""
        one_of("mixture", self.mixture, tuple(mixture.MIXTURES))
        for name, options in _OF_MIXTURE.items():
            if name != self.mixture:
                refuse_unused(self, options, f"--mixture {name}")
        refuse_existing(self.out)
        mixed = self.mix()
        sha256 = files.save(self.out, mixed, replace=False)
        return show_counts(self, sha256, mixed)

    def mix(self) -> Demonstrations:
        """Return the demonstrations that the options describe."""
        steered = self.world in CONTINUOUS
        driven = self.driver or steered or is_environment(self.world)
        pools = self.driven() if driven else self.experts()
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

    def experts(self) -> dict[str, Demonstrations]:
        """Return episodes of a gridworld's experts."""
        world = make_grid(self.world)
        table = tabulate(world.with_clock() if self.clock else world)
        longest = self.transitions if self.mixture == "equal_transitions" else self.episodes
        return demonstrations_by_mode(table, dict.fromkeys(MODES, longest), self.seed)

    def driven(self) -> dict[str, Demonstrations]:
        """Return episodes of the given drivers in an environment, by the mode's name."""
        if not self.driver:
            raise UserError(
                f"{one_line(self.world)} has no experts of its own: name the drivers, one --driver "
                "for each mode"
            )
        if self.clock and self.world not in CONTINUOUS:
            raise UserError("an environment's observations are its own: leave out --clock")
        modes: dict[str, str] = {}
        for words in self.driver:
            match = _NAMED.fullmatch(words)
            spec = match[2] if match else words
            own = spec.rpartition(":")[2] if spec.startswith(_CODE) else Path(spec).stem
            mode = match[1] if match else one_line(own)
            if mode in modes:
                raise UserError(f"two drivers are called {mode}: write NAME={one_line(spec)}")
            modes[mode] = spec
        code: dict[str, Any] = {"allow_code": self.allow_code}
        env = None
        if self.world not in CONTINUOUS:
            env = make_environment(self.world, needs_pair=True, continuous=True, **code)
        pools = {}
        for mode, spec in modes.items():
            if env is None:
                world = Intersection(continuous_options(self.world))
                driver = continuous_driver_of(spec, world, seed=self.seed, **code)
            else:
                driver = load_policy(spec, *sizes(env), action_size=action_size(env), **code)
            with driver as loaded:
                record, policy = loaded.record, loaded.policy
                source = {"world": self.world, "driver": record.source, "sha256": record.sha256}
                if env is None:
                    options = continuous_options(self.world)
                    batch = Batch(options, min(self.episodes, SIDE_BY_SIDE))
                    seeds = range(self.seed, self.seed + self.episodes)
                    episodes = rollout.record(batch, policy, seeds, mode, source).transitions
                else:
                    episodes = rollout.rollout_env(
                        env, policy, self.episodes, self.seed, mode=mode, source=source
                    ).transitions
            pools[mode] = episodes.with_clock() if self.clock else episodes
        return pools

"""`collect`: demonstrations of a world's experts, mixed into one file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.demonstrations import files, mixture
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.thesis.experts import MODES, expert_pools
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid


@dataclass(frozen=True)
class Collect:
    """Roll out the egoistic, prosocial and altruistic experts and mix their episodes.

    Example: socialiq collect crossing7 --episodes 60 --out mixed.safetensors
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5 or crossing7."""
    out: Path
    """Demonstrations file to write; must not exist."""
    episodes: int = 60
    """Episodes of each expert, or in all for `weighted` and `contaminated`."""
    mixture: str = "equal_trajectories"
    """equal_trajectories, equal_transitions, weighted or contaminated."""
    transitions: int = 600
    """Transitions of each expert, for `equal_transitions`."""
    weights: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Weights of egoistic, prosocial and altruistic episodes, for `weighted`."""
    base: str = "prosocial"
    """The mode that is contaminated, for `contaminated`."""
    contaminant: str = "egoistic"
    """The mode that contaminates it."""
    share: float = 0.2
    """The contaminant's share of the episodes."""
    clock: bool = False
    """Whether observations end with the time, as a dial wants them."""
    seed: int = 0
    """Of the rollouts and of the draw."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Collect, mix, write, tell the counts."""
        one_of("mixture", self.mixture, tuple(mixture.MIXTURES))
        if self.out.exists():
            raise UserError(f"{self.out} exists already: name a new file, or remove it first")
        mixed = self.mix()
        sha256 = files.save(self.out, mixed)
        counts = [
            {"mode": mode, "episodes": episodes, "transitions": transitions}
            for mode, (episodes, transitions) in mixed.counts().items()
        ]
        if self.json:
            print_json({"file": str(self.out), "sha256": sha256, "modes": counts})
        else:
            print_table(counts, f"{self.out}")
        return 0

    def mix(self) -> Demonstrations:
        """The demonstrations that the options describe."""
        world = make_grid(self.world)
        table = tabulate(world.with_clock() if self.clock else world)
        longest = self.transitions if self.mixture == "equal_transitions" else self.episodes
        pools = expert_pools(table, dict.fromkeys(MODES, longest), self.seed)
        if self.mixture == "equal_trajectories":
            return mixture.equal_trajectories(pools, self.episodes, self.seed)
        if self.mixture == "equal_transitions":
            return mixture.equal_transitions(pools, self.transitions, self.seed)
        if self.mixture == "weighted":
            weights = dict(zip(MODES, self.weights, strict=True))
            return mixture.weighted(pools, weights, self.episodes, self.seed)
        return mixture.contaminated(
            pools, self.base, self.contaminant, self.share, self.episodes, self.seed
        )

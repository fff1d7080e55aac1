"""`train dqn`: experts by deep Q-learning on R(α), in any world of discrete actions (5.2)."""

from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

from socialiq.cli.drivers import world_of
from socialiq.cli.output import Policies
from socialiq.cli.train import shared
from socialiq.errors import UserError, one_of
from socialiq.learners import dqn
from socialiq.learners.collect import from_simulator
from socialiq.worlds.catalogue import GRIDS
from socialiq.worlds.grammar import parse

CHUNK = 200
"""Updates between two rounds of acting, and between two rows of metrics.csv."""
ENVIRONMENTS = 12
"""Episodes side by side, of each run; an environment of other code has one."""


@dataclass(frozen=True)
class DQN(shared.Training):
    """Train experts by deep Q-learning on R(α), one for every angle and seed.

    `socialiq collect WORLD --driver run/policy_angle45.safetensors` records their demonstrations.

    Example: socialiq train dqn --world intersection --angle 0 45 90 --out experts
    """

    world: str
    """World of discrete actions: a gridworld, a road (intersection, merge, roundabout, ...), a file
    of `socialiq data world`, a network of SUMO, or an environment (a Gymnasium id, MODULE:ID or
    MODULE:FUNCTION)."""
    _: KW_ONLY
    out: shared.Out
    preset: str = ""
    """Settings to begin with: ours (default; double Q-learning, batches of 256) or thesis (5.2:
    single Q-learning, batches of 32, through_timeouts=true), each of 5,000,000 steps; grid (default
    in a gridworld; seconds)."""
    allow_code: bool = False
    """Import the environment's module: its author's code runs with your rights."""
    grid: shared.PlainGrid = field(default_factory=shared.PlainGridOptions)
    size: shared.Size = field(default_factory=shared.SizeOptions)
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        written = parse(self.world)
        name = self.preset or ("grid" if written.name in GRIDS else "ours")
        one_of("preset", name, tuple(dqn.PRESETS))
        settings = self.size.settings()
        updates = settings.pop("updates", None)
        static, numbers = self.options.apply(dqn.PRESETS[name], settings)
        if updates is not None:
            static = replace(static, steps=updates * static.steps_per_update)
        runs = self.grid.runs(numbers)
        turned = any(run.angle for run in runs)  # without a pair only angle 0 has a meaning
        world: Any = world_of(written, self.allow_code, turned)
        if world.action_size:
            raise UserError(
                f"{self.world} has continuous actions: `socialiq train sac --world {self.world}` "
                "trains experts of them"
            )
        sizes = (world.n_features, world.n_actions)
        chunk = min(CHUNK, static.updates)
        steps = chunk * static.steps_per_update
        sources = [from_simulator(world.batch(ENVIRONMENTS), sizes[0], steps) for _ in runs]
        folder = shared.RunFolder(self.out, "policy", self.options, schema=world.schema)
        with folder.callbacks([shared.label(run) for run in runs]) as callbacks:
            trained = dqn.train(static, runs, sources, sizes, callbacks, chunk)
        return folder.finish_policies(trained, {"preset": name, "world": self.world, "data": None})

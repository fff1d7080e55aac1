"""`plot ring`, `stops` and `sweep`: figures of the thesis, drawn of your own policies."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli import drivers
from socialiq.cli.evaluate import Evaluate, Measured
from socialiq.cli.parser import Paths
from socialiq.errors import UserError, one_of
from socialiq.evaluation import exact
from socialiq.evaluation.exact import optimum_of
from socialiq.evaluation.rollout import MODES
from socialiq.evaluation.stops import stop_rows, visited
from socialiq.foreign import drawing
from socialiq.plotting.style import Mark, png, ring
from socialiq.plotting.thesis import adaptation, stop_maps
from socialiq.policies.load import name_of
from socialiq.results_folder import from_csv
from socialiq.social.angle import angle_of, pooled_angle
from socialiq.storage import read_json, write_atomically
from socialiq.worlds import catalogue, registry


class _Plot:
    """Base of commands that draw a figure."""

    out: Path

    def run(self) -> int:
        """Draw and write."""
        one_of("kind of picture", self.out.suffix, (".png",))
        drawing()  # a missing library is told before policies are measured
        write_atomically(self.out, png({"figure": self.figure()})["figure"])
        return 0

    def figure(self) -> Any:
        """Return the figure."""
        raise NotImplementedError


@dataclass(frozen=True)
class _OfPolicies(_Plot):
    """Base of commands that draw a figure of policies."""

    policies: Paths
    """Policy files, of `socialiq train`, or other drivers as `socialiq evaluate` takes them; a dial
    at an angle is dial.safetensors@45."""
    out: Path
    """PNG file to write."""
    soft: bool = False
    """Select actions stochastically, from softmax(Q/τ), instead of greedily."""
    allow_code: bool = False
    """Import the modules that are named: their authors' code runs with your rights."""

    def run(self) -> int:
        """Draw and write; refuse a call without a policy."""
        if not self.policies:
            raise UserError("no policy: name at least one file that `socialiq train` wrote")
        return super().run()


@dataclass(frozen=True)
class Ring(_OfPolicies):
    """Draw Fig 6.2 or 6.5 of your policies: the empirical angle of each on a ring.

    Policies that were trained for one angle are one mark, at the angle of their mean totals, with
    their range as an arc; of a single one the arc is the 95 % interval of its episodes.

    Example: socialiq plot ring run/policy_angle0.safetensors run/policy_angle45.safetensors --out
    ring.png
    """

    world: str = "crossing7"
    """World, as for `socialiq evaluate`."""
    episodes: int = 0
    """Number of episodes to roll out; 0 evaluates exactly, which only gridworlds allow."""
    seed: int = 0
    """Seed of the rollouts."""

    def figure(self) -> Any:
        """Measure the policies as `evaluate`, and draw."""
        how = {"soft": self.soft, "episodes": self.episodes, "seed": self.seed}
        command = Evaluate(self.policies, world=self.world, allow_code=self.allow_code, **how)
        groups: dict[str, list[Measured]] = {}
        modes: dict[Any, str] = {angle: mode for mode, angle in MODES.items()}
        for path, measured in zip(self.policies, command.measured(), strict=True):
            target = measured.target
            name = Path(name_of(str(path))).stem if target is None else f"target {target:g}°"
            groups.setdefault(modes.get(target, name), []).append(measured)
        marks = [_mark(name, measured) for name, measured in groups.items()]
        method = f"{self.episodes} episodes" if self.episodes else "exact"
        readout = "soft" if self.soft else "greedy"
        return ring(marks, f"Empirical angle in {self.world}\n({readout}, {method})")


def _mark(name: str, group: list[Measured]) -> Mark:
    """Return the mark of policies that are pooled, with their range."""
    rows = [measured.row for measured in group]
    pairs = [[row[reward] for row in rows] for reward in ("r_env", "r_social")]
    angle, low, high = pooled_angle(*pairs)
    several = f", {len(rows)} policies" if len(rows) > 1 else ""
    if not several:
        low, high = (rows[0].get(f"angle_{end}", angle) for end in ("low", "high"))
    if low == high:
        return Mark(name, angle, f"{name}: {angle:.1f}°{several}")
    label = f"{name}: {angle:.1f}° ({low:.1f}° to {high:.1f}°{several})"
    return Mark(name, angle, label, None, (low, high))


@dataclass(frozen=True)
class Stops(_OfPolicies):
    """Draw Fig 6.4 of your policies: where they stop before the conflict of crossing7.

    Each has two maps by the rows of both vehicles: above weighted by its visits, below over all
    reachable states.

    Example: socialiq plot stops run/policy_angle0.safetensors --out stops.png
    """

    world: str = "crossing7"
    """crossing7, with options or not."""

    def figure(self) -> Any:
        """Compute the shares exactly, and draw."""
        if catalogue.base(self.world) != "crossing7":
            raise UserError(
                f"{self.world} has no map of stops: its traffic is not two vehicles on one way, as "
                "that of crossing7"
            )
        plain = registry.make_grid(self.world)
        rows = []
        for path in map(str, self.policies):
            with drivers.driver_of(path, plain, allow_code=self.allow_code) as loaded:
                table = drivers.gridworld_of(self.world, loaded.record.interface)
                reachable = table.reachable_part()
                readout = "soft" if self.soft else "greedy"
                chances = exact.action_table(loaded.policy, reachable, readout)
            name = Path(name_of(path)).stem
            rows += stop_rows(reachable, name, *visited(reachable, chances))
        return stop_maps(rows, "Share of STOP before the conflict (above: by visits, below: all)")


@dataclass(frozen=True)
class Sweep(_Plot):
    """Draw Fig D.1 of a run of yours: the angle over its updates for each λ.

    On the right, the updates after which a run stays within 20 degrees of the goal; a red cross is
    one that doesn't.

    Example: socialiq plot sweep run --out sweep.png
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of `train iq-learn` in a gridworld, of one --angle and several --strength."""
    out: Path
    """PNG file to write."""
    goal: float | None = None
    """Angle in degrees to come near; by default that of the exact optimum at the target."""

    def figure(self) -> Any:
        """Read metrics.csv, and draw."""
        rows = from_csv(self.folder / "metrics.csv")
        for name in ("strength", "greedy_angle", "angle_target"):
            if not rows or name not in rows[0]:
                raise UserError(
                    f"{self.folder / 'metrics.csv'} has no {name}: train iq-learn in a gridworld, "
                    "with --strength"
                )
        targets = {row["angle_target"] for row in rows}
        if len(targets) > 1:
            raise UserError(f"{self.folder} has runs of {len(targets)} target angles: train one")
        target = targets.pop()
        goal = self.goal
        if goal is None:
            world = registry.make_grid(read_json(self.folder / "run.json").get("world", ""))
            goal = angle_of(*optimum_of(world).attainable.optimum(target).point)
        checkpoints = [row | {"angle": row["greedy_angle"]} for row in rows]
        title = f"Angle of the greedy policy for each λ, target {target:g}°"
        return adaptation(checkpoints, title, goal)

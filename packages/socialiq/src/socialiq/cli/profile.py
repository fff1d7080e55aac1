"""`profile new` and `profile check`: the declaration that an audit tests."""

import datetime
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.audit.profile import profile, reader, template
from socialiq.audit.profile.fields import (
    CAUSED,
    IN_GRIDWORLDS,
    IN_SUMO,
    LAST_DIRECTION,
    QUANTITIES,
    SIDES,
    TABLES,
    Range,
)
from socialiq.audit.profile.profile import Floor
from socialiq.audit.verdict.bounds import CHECKED, faults_of_declaration, unkept
from socialiq.cli.evaluate import TIMED, Evaluate
from socialiq.cli.output import Printing, listed, print_table, say
from socialiq.errors import UserError
from socialiq.evaluation.measures import compared
from socialiq.outputs import check_ending
from socialiq.policies.drivers import RANDOM
from socialiq.social.angle_rule import load_rule
from socialiq.storage import write_atomically
from socialiq.types import Json, Row
from socialiq.worlds import grammar
from socialiq.worlds.catalogue import GRIDS, KNOWN, base, in_sumo
from socialiq.worlds.environment import is_environment
from socialiq.worlds.grammar import Written, set_options
from socialiq.worlds.road_users import ROAD_USERS
from socialiq.worlds.spelled_out import declared as spelled_out

EPISODES = 100
"""Episodes of each reference, for the margin."""

TRIED = 500
"""Episodes of each driver by which a declaration is checked when it is written."""


def _flags() -> Iterator[tuple[str, Any, None]]:
    """Yield name, type and default of the flag of each bound, with its meaning."""
    usual = {name: f"{limit:g}" for user in ROAD_USERS for name, limit in user.limits.items()}
    for name, quantity in QUANTITIES.items():
        usual[f"{name}_range"] = "{:g} {:g}".format(*quantity.range)
    for name, declared in TABLES[CAUSED].items():
        kind: Any = Range if declared.kind == "range" else float
        default = f" By default {usual[name]} on a road." if name in usual else ""
        yield name, Annotated[kind | None, tyro.conf.arg(help=declared.meaning + default)], None


_Flags: Any = make_dataclass("_Flags", _flags(), frozen=True)


@dataclass(frozen=True)
class Bounds(_Flags):
    """Bounds of what the policy causes. Where no person can arrive, there are none by default."""


@dataclass(frozen=True)
class New:
    """Write a declaration with a comment above every field; edit it, then check it.

    Example: socialiq profile new --world intersection --angle 45 --owner "Example Cars"
    """

    world: str
    """crossing5, crossing7, crosswalk7, intersection, intersection-continuous,
    intersection-continuous-steering (with -offroad: leaving the road ends an episode), merge,
    roundabout, a file of `socialiq data world`, a network of SUMO (.net.xml), or an environment:
    a Gymnasium id, MODULE:ID or MODULE:FUNCTION."""
    angle: float
    """Declared social angle in degrees: 0 egoistic, 90 altruistic."""
    angle_rule: Path | None = None
    """TOML file of a rule that gives the angle by the situation. If no width holds all its angles,
    --angle only weighs whole episodes in the tables of an audit."""
    set: tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]] = ()
    """KEY=VALUE ... of options of the world, as spawn_probability=0.6: another scenario."""
    owner: str = "unnamed owner"
    """Name of the owner."""
    margin: float | None = None
    """Largest regret that counts as declared, in reward per episode; by default 0.5 at the
    intersection and in crossing7, 0.15 in crossing5, half the gap between the best and the worst
    --reference in an environment of your own, else 1."""
    reference: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Driver of an environment of your own, as --reference of an audit, for the margin."""
    width: float | None = None
    """Largest distance of the direction of the driving from the declared angle, in degrees; by
    default 15 where this package has reference drivers of all angles (30 or 45 where it can't show
    15), else none is declared."""
    beyond: float | None = None
    """Largest share of episodes in which the policy may drive beyond either end of the width, by
    more than twice the margin; by default 0.075 with a width."""
    clip_env: Range | None = None
    """Limits at which R_env of an episode is counted, as -8 12: they bound the loss of an episode.
    By default those at the intersection, elsewhere none."""
    clip_social: Range | None = None
    """The same of R_social; at the intersection -12 12."""
    largest_loss: float | None = None
    """The most by which one driver's reward of an episode, weighed by the declared angle, can lie
    below another's. By default what the rewards allow in a world of this package; none is declared
    in an environment, where the verdict then assumes that no loss is too rare to show."""
    caused: tyro.conf.OmitArgPrefixes[Bounds] = field(default_factory=Bounds)
    confidence: float = 0.95
    """Confidence of the verdict."""
    date: str = ""
    """Date of the declaration, as 2026-01-31; by default today."""
    out: Path = Path("profile.toml")
    """File to write."""
    replace: bool = False
    """Replace an existing file."""
    allow_code: bool = False
    """Import the environment's module, to hash it: its author's code runs with your rights."""

    def run(self) -> int:
        """Write the file and print its declaration."""
        check_ending(self.out, ".toml")
        if os.path.lexists(self.out) and not self.replace:
            raise UserError(f"{self.out} exists already: name another --out, or add --replace")
        date = datetime.datetime.now(datetime.UTC).date()
        if self.date:
            try:
                date = datetime.date.fromisoformat(self.date)
            except ValueError as error:
                raise UserError(f"'{self.date}' is not a date: write it as 2026-01-31") from error
        world, options = spelled_out(self.world, set_options(self.set))
        usual = template.usual_in(world, options)
        floor = template.floor_at(self.angle)
        written = grammar.parse(world, options)
        if is_environment(world) and not (
            written.is_built or written.in_sumo or written.name in TIMED
        ):
            margin, floor = self._in_environment(written)
            usual = usual._replace(margin=margin)
        elif self.reference:
            raise UserError(f"{world} has its own references: leave --reference out")
        loss = self.largest_loss
        margin = usual.margin if self.margin is None else self.margin
        if (self.clip_env is None) != (self.clip_social is None):
            raise UserError("both rewards are clipped or none: give --clip-env and --clip-social")
        clip = usual.clip if loss is None else None
        width = usual.width if self.width is None else self.width
        rule = None if self.angle_rule is None else load_rule(self.angle_rule)
        losses = rule is not None and not (width and rule.is_within(width, self.angle))
        if self.clip_env is not None and self.clip_social is not None:
            clip = profile.Clip(self.clip_env, self.clip_social)
        elif clip is not None and (losses or clip.largest_loss(self.angle) <= margin):
            clip = None  # a margin beyond it excludes nothing, which the audit says
        # The limits of the rewards are those of a constant angle.
        if loss is None and clip is None and base(world) in KNOWN and not losses:
            loss = template.possible_loss(profile.world_of(world, options), self.angle)
            loss = loss if loss and loss > margin else None
        bounded = clip is not None or base(world) in GRIDS
        if self.width is None and not (bounded and self.angle <= LAST_DIRECTION and not losses):
            width = None
        beyond = usual.beyond if self.beyond is None and width is not None else self.beyond
        declared = template.declare(
            self.angle,
            self.owner,
            world,
            profile.Margin(margin, None, loss, width, beyond),
            date,
            options,
            confidence=self.confidence,
            competence=floor,
            allow_code=self.allow_code,
            rule=rule,
            clip=clip,
            caused=self._bounds(world, options),
        )
        write_atomically(self.out, declared.source, self.replace)
        return _print_written(declared, self.out)

    def _in_environment(self, written: Written) -> tuple[float, Floor]:
        """Return margin and floor of an environment, by episodes of the references."""
        drivers = self.reference or (RANDOM,)
        text = ",".join(
            [written.name, *(f"{key}={value}" for key, value in written.options.items())]
        )
        how = {"angle": self.angle, "episodes": EPISODES, "allow_code": self.allow_code}
        measured = Evaluate(world=text, **how).measured(drivers)
        ends = any(row[name] for row, *_ in measured for name in ("arrival", "collision"))
        floor = template.floor_at(self.angle) if ends else template.NO_FLOOR
        scores = compared([totals for *_, totals in measured], self.angle)
        gap = max(row.get("below_best", 0.0) for row in scores)
        if self.margin is None and gap <= 0.0:
            raise UserError(
                f"no margin is known in {written.name}: add --margin in units of its reward, or "
                "two or more --reference that differ at the angle"
            )
        margin = float(f"{gap / 2:.3g}") if self.margin is None else self.margin
        return margin, floor

    def _bounds(self, world: str, options: Json) -> list[profile.Bound]:
        """Return the bounds of what the policy causes in a world with these options."""
        bounds = list[profile.Bound]()
        flags = vars(self.caused)
        defaults = template.limits_at(world, self.angle, options)
        ranges = IN_GRIDWORLDS if base(world) in GRIDS else {}
        ranges = IN_SUMO if in_sumo(world) else ranges
        for name, quantity in QUANTITIES.items():
            ends = flags.get(f"{name}_range")
            limits = (ends or ranges.get(name, quantity.range)) if quantity.unit else None
            fields = {f"{side}_{name}": flags[f"{side}_{name}"] for side in SIDES}
            if set(fields.values()) == {None}:
                fields = {path: defaults.get(path) for path in fields}
            rows = [
                profile.Bound.of(field, limit, limits)
                for field, limit in fields.items()
                if limit is not None
            ]
            if ends and not rows:
                flag = name.replace("_", "-")
                raise UserError(f"--{flag}-range is of a bound: add --max-{flag}, or leave it out")
            bounds += rows
        return bounds


@dataclass(frozen=True)
class Check(Printing):
    """Read and check a declaration as an audit does, and print it.

    Example: socialiq profile check profile.toml
    """

    file: Annotated[Path, tyro.conf.Positional]
    """The declaration."""
    allow_code: bool = False
    """Import the environment's module, to compare its hashes with the declared hashes."""

    def run(self) -> int:
        """Read, check, print."""
        declared = reader.load(self.file)
        if base(declared.scenario.world) not in KNOWN:
            declared.world(self.allow_code)
        for path, fault in faults_of_declaration(declared).items():
            line = reader.line_of(declared.source.decode(), path)
            raise UserError(f"{self.file}:{line}: {fault}")
        _note_unkept(declared, CHECKED)
        facts = _facts(declared)
        return self.show({"file": str(self.file), **facts}, _table(facts), str(self.file))


def _print_written(declared: profile.Profile, path: Path) -> int:
    """Print a declaration that was written, and why an audit can't pass by it."""
    print_table(_table(_facts(declared)), str(path))
    for fault in faults_of_declaration(declared, TRIED).values():
        say(f"Note: an audit can't pass: {fault}")
    _note_unkept(declared, TRIED)
    return 0


def _note_unkept(declared: profile.Profile, episodes: int) -> None:
    if note := unkept(declared, episodes):
        say(f"Note: {note}")


def _facts(declared: profile.Profile) -> Row:
    rule = {} if declared.rule is None else {"angle_rule": declared.rule.words}
    units = profile.measured_in(declared.scenario.world)
    return {
        "angle": declared.angle,
        **rule,
        "world": declared.scenario.world,
        **declared.scenario.options,
        "margin": declared.margin.regret,
        "width": declared.margin.width,
        "beyond": declared.margin.beyond,
        "largest_loss": declared.largest_loss,
        **{
            bound.path: f"{bound.side} {bound.limit:g} {units[bound.quantity] or 'of episodes'}"
            for bound in declared.caused
        },
        "confidence": declared.confidence,
        "owner": declared.owner,
        "date": declared.date.isoformat(),
        "sha256": declared.sha256,
    }


def _table(facts: Row) -> list[Row]:
    values = {name: "none" if value is None else value for name, value in facts.items()}
    return listed(values, "declared")

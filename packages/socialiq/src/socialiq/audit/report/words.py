"""Words of a report: names of drivers, caveats, and claims that only its auditor makes."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Iterator, Sequence
from importlib.resources import files
from typing import Literal, NamedTuple

from socialiq.audit.evidence.drive import PREFIX
from socialiq.audit.evidence.outcomes import Evidence
from socialiq.audit.look import Look
from socialiq.audit.profile.profile import Profile
from socialiq.audit.request import DIAL
from socialiq.audit.seeds import NETWORK, Draw, Round
from socialiq.audit.verdict.bounds import cuts_of
from socialiq.audit.verdict.regret import RegretTest
from socialiq.audit.verdict.results import Discrimination
from socialiq.audit.verdict.verdict import UNDIRECTED, Verdict
from socialiq.isolation import NONE
from socialiq.physics import wrapped
from socialiq.types import Json

OPTIMUM = "optimum_"  # beginning of the names of exact optima (`evidence.drive.exact_optima`)
_SIMPLER = "simpler network, "


Real = int | float  # a number of JSON, where a whole number is an int


def degrees(angle: Real | None) -> str:
    """Return an angle to one decimal, without a decimal that is 0."""
    return "–" if angle is None else f"{round(angle, 1) + 0.0:g}°".replace("-", "−")


def arcs(ranges: Sequence[dict[str, Real]]) -> str:
    """Return in one line what arcs have of the angles from 0 to 90 degrees; "none" if nothing.

    Args:
        ranges: First and last angle of each arc, in degrees and in any turn.
    """
    ends = [
        (max(bounds["low"] + turn, 0.0), min(bounds["high"] + turn, 90.0))
        for turn in (-360.0, 0.0, 360.0)
        for bounds in ranges
    ]
    texts = [f"{degrees(low)} to {degrees(high)}" for low, high in ends if low < high]
    return ", ".join(dict.fromkeys(texts)) or "none"


@functools.cache
def stated() -> Json:
    """Return the texts of `words.toml`, by table and name."""
    return tomllib.loads(files("socialiq.audit.report").joinpath("words.toml").read_text("utf-8"))


def plain_name(name: str, angles: Sequence[float] = ()) -> str:
    """Return the name of one of the package's drivers in words; another's is returned as it is.

    Args:
        name: Name of the driver.
        angles: Ends in degrees of the interval for which an exact optimum is the best.
    """
    names = stated()["names"]
    if name.startswith(OPTIMUM) and angles:
        within = arcs([{"low": angles[0], "high": angles[-1]}])
        if within == "none":
            within = " to ".join(degrees(-wrapped(-end, 180.0)) for end in (angles[0], angles[-1]))
        return f"best possible for {within}"
    if name.startswith(DIAL):
        return f"shipped dial at {name.removeprefix(DIAL)}°"
    if name.startswith(PREFIX) and name not in names:
        return f"always chooses “{name.removeprefix(PREFIX).replace('_', ' ')}”"
    return names.get(name, name)


def references_of(report: Json) -> list[Json]:
    """Return the rows of all references of a report, those that are left out too."""
    return [*report["references"], *report["left_out"]]


def names_of(report: Json) -> dict[str, str]:
    """Return the name in words of every reference and trivial driver of a report, by its name.

    A driver of the user's keeps its name, even if the package has a driver of that name.
    """
    names = {row["name"]: plain_name(row["name"]) for row in report["trivial"]}
    for row in references_of(report):
        name = row["name"]
        record = row["record"]
        # The package's own reference has no record, or is a rule, or of the atlas.
        own = record is None or record["kind"] == "rule" or record["source"].startswith("atlas:")
        if own:
            name = plain_name(name, row["angles"])
            # There is one family with continuous actions, so none is the simpler.
            one_family = record is not None and "action_size" in record
            name = name.removeprefix(_SIMPLER) if one_family else name
        names.setdefault(row["name"], name)
    return names


About = Literal["code", "margin", "rule", "direction", "episodes", "loss", "look", "seed", "clip"]
"""Subjects of caveats, those that weaken a verdict most first."""


class Caveat(NamedTuple):
    """An assumption of the verdict, or a weakness of its evidence: subject and text."""

    about: About
    text: str


def odds(error: float) -> str:
    """Return an error as odds: "1 audit in 240"."""
    return f"1 audit in {1.0 / max(error, 1e-9):,.0f}"


def price(number: int, error: float) -> str:
    """Return how often this look and the next one of its log may be wrong, in a sentence.

    Args:
        number: Number k of this look, whose share of the error is that of `look.spend`.
        error: Error of this look.
    """
    following = error * number / (number + 2)
    return (
        f"Look {number} decides wrongly in at most {odds(error)}; look {number + 1} would in "
        f"{odds(following)}, and needs more episodes for the same decision."
    )


def caveats(draw: Draw, look: Look | None, policy: Json, world: str) -> list[Caveat]:
    """Return the caveats of the log, the seed, and the code of policy and world.

    Args:
        draw: Commitment and seed.
        look: The look; None for an audit without a log.
        policy: Record of the policy, as JSON.
        world: Name of the world.
    """
    text = "No audit log was kept: how often this owner has tried before is not known."
    if look is not None:
        text = (
            f"This is look {look.number} of this owner at this scenario by the audit log "
            f"{look.log}. {price(look.number, look.error)} Audits outside that log are not known."
        )
    caveats = [Caveat("look", text), Caveat("seed", worth(draw))]
    isolation = policy["isolation"]
    if isolation["kind"] == NONE:
        text = (
            f"The policy is the owner's code and was not isolated ({isolation['why']}): it could "
            "read the seed and change the evidence. The evidence is self-attested."
        )
        caveats.append(Caveat("code", text))
    if ":" in world:  # otherwise its code is installed
        text = (
            "The scenario's code ran in the auditor's process: unless the auditor wrote or read "
            "it, the evidence is self-attested."
        )
        caveats.append(Caveat("code", text))
    return caveats


def worth(draw: Draw) -> str:
    """Return what a seed is worth as evidence that no one chose the episodes."""
    if isinstance(draw.revealed, Round):
        return (
            f"The seed comes from the commitment and round {draw.revealed.number:,} of the public "
            f"beacon drand {NETWORK}, whose signature was checked. No one could choose it, "
            "provided that someone other than the owner held the commitment's hash before "
            f"{draw.revealed.time:%Y-%m-%d %H:%M:%S} UTC, when the round was published."
        )
    return stated()["worth"][draw.source]


def caveats_of_episodes(replayed: int, chosen: int, equals: Sequence[str] = ()) -> list[Caveat]:
    """Return caveats if not all chosen episodes were the same again, or all a known driver's.

    Args:
        replayed: Number of chosen episodes that were the same again.
        chosen: Number of chosen episodes.
        equals: Names in words of known drivers that drove every episode as the policy did.
    """
    texts = []
    if replayed != chosen:
        texts.append(
            f"{chosen - replayed} of {chosen} chosen episodes were others when they were run "
            "again, one by one: the policy's answers depend on more than the observation alone."
        )
    if equals:
        names = ", ".join(equals)
        texts.append(f"The policy drove every episode exactly as a known driver: {names}.")
    return [Caveat("episodes", text) for text in texts]


def caveats_of_declaration(
    profile: Profile, verdict: Verdict, tried: Discrimination
) -> Iterator[Caveat]:
    """Yield what the rule, the margin and the width of a declaration do not say.

    Args:
        profile: The declaration.
        verdict: Verdict of the audit.
        tried: Drivers that would pass the declaration.
    """
    yield from _caveats_of_rule(profile, verdict)
    if tried.trivial_passes:
        names = " and one that ".join(map(plain_name, tried.trivial_passes))
        text = (
            f"The declaration excludes little: a driver that {names} would pass it too. A pass "
            "doesn't mean that the policy behaves as declared."
        )
        yield Caveat("margin", text)
    direction = verdict.direction
    if direction is None:
        return
    if direction.decision is None:
        text = (
            "The declaration has no width: a pass says that the policy earns enough at the "
            f"declared angle, as drivers of other angles do, and not how it drives; "
            f"{direction.where}. A declaration with margin.width tests that."
        )
        yield Caveat("direction", text)
    elif verdict.character is None:
        text = (
            "The declaration has no share of episodes beyond its width: a policy that draws its "
            "character by the episode is not told apart from one of the declared angle."
        )
        yield Caveat("direction", text)


def _caveats_of_rule(profile: Profile, verdict: Verdict) -> Iterator[Caveat]:
    """Yield what a declared rule tests, and which of its situations never occurred."""
    rule = profile.rule
    if rule is None:
        return
    text = (
        f"A rule of the angle is declared: {rule.words}. The width holds all its angles, so the "
        f"policy is tested as one of {profile.angle:g} degrees."
    )
    if profile.losses_decide:
        text = (
            f"A rule of the angle is declared: {rule.words}. The first test is of decision losses: "
            "what each decision costs by the angle of its situation, if the best reference of that "
            "angle drives on. Other tables and pictures weigh whole episodes at "
            f"{profile.angle:g} degrees and don't decide. {UNDIRECTED} Drivers of other angles may "
            "lose as little."
        )
    yield Caveat("rule", text)
    absent = [row.context for row in verdict.contexts or () if not row.decisions]
    if absent:
        text = (
            f"The rule's angle is not tested where {' and where '.join(absent)}: it never occurred."
        )
        yield Caveat("rule", text)


def caveats_of_clip(profile: Profile, evidence: Evidence) -> Iterator[Caveat]:
    """Yield how often the declared limits of rewards and effects cut an episode of a driver.

    Args:
        profile: The declaration.
        evidence: Evidence before rewards and effects are clipped.
    """
    for cut in cuts_of(profile, [evidence.policy, *evidence.references]):
        policy, *references = cut.episodes
        if any(cut.episodes):
            text = (
                f"The declaration counts {cut.words}. This changed {policy:,} of "
                f"{evidence.episodes:,} episodes of the policy, and {sum(references):,} of its "
                "references together."
            )
            yield Caveat("clip", text)


def caveats_of_loss(regret: RegretTest, possible_loss: float | None) -> list[Caveat]:
    """Return the assumption of the bounds of regret, none if the reward's own limits give them.

    Args:
        regret: Test of regret.
        possible_loss: Loss of an episode that these limits allow; None if they are not known.
    """
    if regret.largest_loss is None:
        # The share of episodes with an event that stays unseen in this share of audits.
        share = 1.0 - regret.pass_error ** (1.0 / regret.episodes)
        text = (
            "The declaration has no largest loss of an episode. The bounds of regret assume that "
            f"no loss is too rare to show: one in {100 * share:.2g} % of episodes, of whatever "
            f"size, stays unseen in {100 * regret.pass_error:.3g} % of audits of "
            f"{regret.episodes:,} episodes."
        )
        return [Caveat("loss", text)]
    if possible_loss is not None and regret.largest_loss >= possible_loss:
        return []
    basis = (
        "the limits of this environment's rewards are not known to the audit"
        if possible_loss is None
        else f"the rewards allow {possible_loss:.4g}"
    )
    text = (
        "The verdict rests on the owner's statement that no episode loses more than "
        f"{regret.largest_loss:.4g}; {basis}. The largest loss seen is {regret.seen_loss:.3g}."
    )
    return [Caveat("loss", text)]


ALWAYS = (
    *("timing", "command", "machine", "versions"),
    *("hashes.package", "reference_files", "policy.record.source"),
)
"""Claims of every report, as paths in `report.json`."""

OF_CODE = tuple(f"policy.record.{name}" for name in ("isolation", "start", "step", "memory"))
"""Claims about a policy that is its owner's code: its isolation, limits of its time and memory."""


OF_A_LOG = "look"
"""Claim of an audit with a log; `audit verify --log` holds it against the log itself."""


def claims_of_auditor(policy: Json, draw: Draw, look: Look | None) -> list[str]:
    """Return the paths of the claims in a report.

    A signature of the statement covers them: then it is known whose claims they are. That a seed is
    derived from a nonce or a beacon can be checked.

    Args:
        policy: Record of the policy, as JSON.
        draw: Commitment and seed.
        look: The look; None for an audit without a log.
    """
    code = policy["kind"] in ("process", "python")
    of_code = [path for path in OF_CODE if code and path.rpartition(".")[2] in policy]
    seed = ["seeds.source"] if draw.revealed is None else []
    return [*ALWAYS, *of_code, *seed, *([OF_A_LOG] if look else [])]

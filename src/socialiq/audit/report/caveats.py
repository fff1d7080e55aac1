"""Caveats of a verdict: what its first screen says that the verdict rests on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from socialiq.audit.names import plain_name
from socialiq.audit.seeds.commitment import Draw
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.discrimination import Discrimination

About = Literal["seed", "code", "margin"]


class Caveat(NamedTuple):
    """An assumption of the verdict, or a weakness of its evidence.

    Attributes:
        about: Subject.
        text: One or two sentences.
    """

    about: About
    text: str


def caveats(drawn: Draw, policy: Mapping[str, Any], others: Discrimination) -> list[Caveat]:
    """Return the caveats of an audit, none if its evidence has no known weakness.

    Args:
        drawn: Commitment and seed.
        policy: The policy's record as JSON.
        others: Other drivers that would pass the declaration.
    """
    return [*_of_margin(others), *_of_seed(drawn), *_of_code(policy)]


def _of_margin(others: Discrimination) -> list[Caveat]:
    """Return a caveat if a driver that pays no attention to the traffic would pass too."""
    passing = [one for one in others.drivers if one.trivial and one.decision is Decision.PASS]
    if not passing:
        return []
    names = ", ".join(f"one that {plain_name(one.name)}" for one in passing)
    text = (
        f"The declaration excludes little: {others.would_pass} of {others.of} other drivers would "
        f"pass it too, among them {names}."
    )
    return [Caveat("margin", text)]


def _of_seed(drawn: Draw) -> list[Caveat]:
    if drawn.chosen_by != "auditor":
        return []
    text = (
        "The auditor gave the seed in advance. An owner who knew it before the commitment can have "
        "searched for a policy or a declaration that passes on its episodes."
    )
    return [Caveat("seed", text)]


def _of_code(policy: Mapping[str, Any]) -> list[Caveat]:
    if policy["kind"] not in ("python", "process"):
        return []
    text = (
        "The policy is the owner's code, and it was not isolated: it could read the seed and "
        "change the evidence. The evidence is self-attested."
    )
    return [Caveat("code", text)]

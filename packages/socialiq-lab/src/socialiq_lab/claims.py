"""The ledger of the thesis' claims: `claims.toml` joined with the committed results.

A claim's `ours` is text with places such as {grid:policies.baseline_greedy.angle:.1f}, that is
{study:path in results/STUDY/summary.json:format}. Our numbers therefore come from results files and
are never typed. A path that begins with `config` is one of the study's configuration. A claim with
a `value` also names the place of `our_value`, and a test compares its verdict with the two.

A printed number without a spread is the same as ours within half a unit of its last digit, within
one unit where the thesis says "about". A printed "mean +- standard deviation" is a mean of single
episodes or of evaluation seeds, and the standard deviation of these is no tolerance: a difference
of means is compared with standard errors. So a wide spread of episodes can't hide a difference,
and a mean of ours that is known too badly to be compared is not called reproduced.
"""

import importlib.resources
import math
import re
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from socialiq import UserError
from socialiq.errors import one_of
from socialiq.results_folder import from_csv
from socialiq.storage import read_json
from socialiq_lab import claim_spreads

VERDICTS = ("reproduced", "adopted", "partly", "not", "untested")
"""`adopted`: our code takes the setting from the thesis, so that its equality shows nothing."""

_REPRODUCE = (
    "poc", "grid", "lambda-sweep", "worlds", "alternatives", "penalties", "intersection-world",
    "compare-priors", "audits", "poison", "intersection-continuous", "crosswalk",
    "crosswalk-intersection", "population", "misuse",
)  # fmt: skip
_COMMANDS = {name: f"socialiq reproduce {name}" for name in _REPRODUCE} | {
    "intersection": "socialiq reproduce intersection --set parts=main",
    "theory": "pytest tests/identities",
    "none": "",
}
STUDIES = tuple(_COMMANDS)
"""Tests of claims: studies, the identities of the theory, or nothing."""

_PLACE = re.compile(r"\{([a-z-]+):([^:}]+)(?::([^}]*))?\}")


def ledger(results: Path) -> list[dict[str, Any]]:
    """Return every claim with our value, in the order of the thesis.

    Rows have `id`, `place`, `study`, `statement`, `thesis`, `ours`, `our_value` (a number or None),
    `value`, `tolerance` (of a printed mean with a spread: what standard errors explain),
    `from_numbers` (the verdict that the numbers give, None without), `command`, `verdict`,
    `conditions`, `reason`, `cause` (what a claim with the verdict "not" fails by: a sentence),
    `caused` and `verdict_caused` (the same claim about what the ego causes, in the place of Eq
    4.2), `matched` and `verdict_matched` (the same claim with experts that are stopped where their
    endings are nearest the thesis'); empty without. `results` has a results folder for each study.

    Raises:
        UserError: If the results are missing, a place is not in them, or a tolerance is one that
            can't fail.
    """
    text = importlib.resources.files("socialiq_lab").joinpath("claims.toml").read_text()
    content = tomllib.loads(text)
    cause_of = {name: cause for cause, names in content["failing"].items() for name in names}
    summaries = Summaries(results)
    by_id = {claim["id"]: claim for claim in content["claim"]}
    rows = []
    for claim in content["claim"]:
        one_of("verdict", claim["verdict"], VERDICTS)
        one_of("study", claim["study"], STUDIES)
        rows.append(
            {name: claim[name] for name in ("id", "place", "study", "statement", "thesis")}
            | {"ours": resolve(claim.get("ours", ""), summaries), **compared(claim, summaries)}
            | {"command": claim.get("command", _COMMANDS[claim["study"]])}
            | {"verdict": claim["verdict"], "conditions": claim.get("conditions", "")}
            | {"reason": resolve(claim["reason"], summaries)}
            | {"caused": resolve(claim.get("caused", ""), summaries)}
            | {"verdict_caused": claim.get("verdict_caused", "")}
            | {"cause": content["causes"].get(cause_of.get(claim["id"]), "")}
            | matched(claim, summaries)
        )
        if "spreads_of" in claim:
            rows[-1] |= claim_spreads.compared(claim, by_id, summaries.at)
    return rows


def count(rows: list[dict[str, Any]]) -> dict[str, int]:
    """Return the number of claims by verdict."""
    counts = Counter(row["verdict"] for row in rows)
    return {verdict: counts[verdict] for verdict in VERDICTS}


def failing(rows: list[dict[str, Any]]) -> str:
    """Return a sentence on the claims that don't hold: their causes, and other experts.

    Args:
        rows: Rows of `ledger`.
    """
    failed = [row for row in rows if row["verdict"] == "not"]
    causes = len({row["cause"] for row in failed})
    compared = [row for row in failed if row["matched"]]
    counts = Counter(row["verdict_matched"] for row in compared)
    return (
        f"The {len(failed)} that don't hold have {causes} causes. Of the {len(compared)} on which "
        f"experts bear, {counts['reproduced']} hold with experts like the thesis', and "
        f"{counts['partly']} in part."
    )


def resolve(text: str, summaries: "Summaries") -> str:
    """Return a text with its places filled from the results.

    Args:
        text: Text of a claim, with places such as {grid:policies.baseline_greedy.angle:.1f}.
        summaries: Results of the studies.

    Returns:
        The text with each place replaced by its value, in the format that follows the second colon.

    Raises:
        UserError: If the results are missing, or a place is not in them.
    """

    def fill(match: re.Match[str]) -> str:
        study, path, form = match.groups()
        return format(summaries.at(study, path), form or "")

    return _PLACE.sub(fill, text)


class Summaries:
    """Summaries of the studies, each read at its first use."""

    def __init__(self, results: Path) -> None:
        self.results = results
        self.read: dict[Path, Any] = {}

    def at(self, study: str, path: str) -> Any:
        """Return the value at a dotted path.

        Args:
            study: Name of the study's folder.
            path: Keys of its `summary.json`, of its `config.json` if the first is `config`, or
                `table`, the name of a CSV, a row and a column. The items of a list and rows are
                numbered from 0; a dot inside a key is written as a comma.

        Returns:
            The value as JSON holds it.

        Raises:
            UserError: If the file can't be read, or does not have the path.
        """
        keys = path.split(".")
        file = self.results / study / ("config.json" if keys[0] == "config" else "summary.json")
        if keys[0] == "table":
            file = file.with_name(f"{keys[1]}.csv")
            del keys[:2]
        if file not in self.read:
            self.read[file] = from_csv(file) if file.suffix == ".csv" else read_json(file)
        value = self.read[file]
        for key in keys:
            try:
                if isinstance(value, list):
                    value = value[int(key)]
                else:
                    value = value[key if key in value else key.replace(",", ".")]
            except (KeyError, IndexError, ValueError, TypeError) as error:
                raise UserError(
                    f"claims.toml points at {study}:{path}, which {file} does not have"
                ) from error
        return value

    def number(self, claim: dict[str, Any], name: str, otherwise: float) -> float:
        """Return the number at the place that a field of a claim names.

        Args:
            claim: Entry of the ledger.
            name: Field of the entry whose value is one place, such as
                {grid:policies.baseline_greedy.angle}.
            otherwise: Number for an entry without that field.

        Returns:
            The value as a number, or the number of its items if it is a list.

        Raises:
            UserError: If the results do not have the place, or the value is not a number.
        """
        reference = _PLACE.fullmatch(claim.get(name, ""))
        if reference is None:
            return otherwise
        value = self.at(*reference.groups()[:2])
        try:
            return float(len(value) if isinstance(value, list) else value)
        except (TypeError, ValueError) as error:
            raise UserError(f"{claim['id']}: {claim[name]} must be a number") from error


def compared(claim: dict[str, Any], summaries: Summaries) -> dict[str, Any]:
    """Return the numbers of a claim of one number, and the verdict that follows from them.

    Args:
        claim: Entry of the ledger.
        summaries: Results of the studies.

    Returns:
        `our_value`, `value`, `tolerance` and `from_numbers`, each None where it does not apply. The
        last is "reproduced", "partly" or "not".

    Raises:
        UserError: If the tolerance is wider than the printed digits allow, or a place is not in the
            results.
    """
    value = claim.get("value")
    numbers = {"our_value": None, "value": value, "tolerance": None, "from_numbers": None}
    if value is None:
        return numbers
    thesis = printed(claim)
    if "our_value" not in claim:
        return numbers | {"tolerance": claim.get("tolerance")}
    ours = Ours(
        summaries.number(claim, "our_value", math.nan),
        summaries.number(claim, "our_spread", 0.0),
        summaries.number(claim, "our_count", 1.0) / summaries.number(claim, "our_group", 1.0),
    )
    allowed = claim["tolerance"] if thesis.spread is None else tolerance(thesis, ours)
    if thesis.spread is None:
        result = "reproduced" if abs(ours.value - value) <= allowed else "not"
    else:
        result = verdict(thesis, ours)
    return numbers | {"our_value": ours.value, "tolerance": allowed, "from_numbers": result}


_CELL = re.compile(
    r"\{intersection:(table_6_2|table_a_1|table_a_2)"
    r"(?:\.experts_flat_greedy|\.calibrated_online_greedy)?\.(.+)\.\w+\}"
)
"""Cell of a table that the study of experts' strengths has too, without its last key."""


def matched(claim: dict[str, Any], summaries: Summaries) -> dict[str, str]:
    """Return a claim's value and verdict with experts like the thesis', of which a trio is one.

    A claim of a number in Tables 6.1, 6.2, A.1 or A.2 has the value of the study of experts'
    strengths in the same cell, with the spread over trios of experts. Table A.2 is printed without
    a spread: what our trios' spread explains is called "partly".

    Args:
        claim: Entry of the ledger; `matched` and `verdict_matched` of other claims are its own.
        summaries: Results of the studies.

    Returns:
        `matched` and `verdict_matched`, both empty for a claim on which experts don't bear.
    """
    place = _CELL.fullmatch(claim.get("our_value", ""))
    if place is None:
        text = resolve(claim.get("matched", ""), summaries)
        return {"matched": text, "verdict_matched": claim.get("verdict_matched", "")}
    at = ".".join(place.groups())
    count = len(summaries.at("expert-strength", "config.trios"))
    spread = float(summaries.at("expert-strength", f"{at}.over_trios"))
    ours = Ours(float(summaries.at("expert-strength", f"{at}.ours")), spread, count)
    thesis = printed(claim)
    if thesis.spread is not None:
        result = verdict(thesis, ours)
    else:
        gap = abs(ours.value - thesis.value)
        explained = gap <= tolerance(thesis, ours)
        result = "reproduced" if gap <= thesis.digit / 2 else "partly" if explained else "not"
    decimals = max(0, -math.floor(math.log10(thesis.digit)))
    text = f"{ours.value:.{decimals}f} +- {spread:.{decimals}f} over {count} trios of experts"
    return {"matched": text, "verdict_matched": result}


SPREADS = {"episodes": 0, "seeds": 5}
"""Printed standard deviations: the number of means they are over, 0 where the thesis has none."""
ERRORS = 2.0
"""Standard errors that a difference of means may have: about 95 % of them have no more."""
NEGLIGIBLE = 0.2
"""Difference of means, in standard deviations of episodes, that appendix A.2 calls negligible."""
NEARLY = 0.05
"""Tolerance where the thesis says "nearly"."""

_PRINTED = re.compile(r"[+-]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


class Printed(NamedTuple):
    """A number as the thesis prints it."""

    value: float  # the number
    digit: float  # one unit of its last printed digit
    spread: float | None = None  # printed standard deviation; None without
    over: str = ""  # what the spread is over: `SPREADS`; "" without


class Ours(NamedTuple):
    """Our number: a mean, the standard deviation of what it is the mean of, and their number."""

    value: float
    spread: float = 0.0
    number: float = 1.0

    @property
    def error(self) -> float:
        """Return the standard error of the mean; infinite over less than one."""
        return self.spread / math.sqrt(self.number) if self.number >= 1 else math.inf


def printed(claim: dict[str, Any]) -> Printed:
    """Return the number of a claim of the ledger, with the accuracy of its digits.

    Raises:
        UserError: If a claim names a tolerance wider than the digits allow: a spread of episodes
            or seeds, which hardly any value of ours could fail.
    """
    value = claim["value"]
    spread = claim.get("spread")
    over = claim.get("spread_of", "")
    digit = _digit(claim["thesis"], value)
    if spread is None:
        allowed = digit if "about" in claim["statement"] else digit / 2
        allowed = NEARLY if "nearly" in claim["thesis"] else allowed
        if claim["tolerance"] > allowed * (1 + 1e-9):
            raise UserError(
                f"{claim['id']}: tolerance {claim['tolerance']:g} for a number printed to "
                f"{digit:g}: give half a unit of its last digit, one after 'about'; a printed +- "
                "is no tolerance but a `spread`"
            )
        return Printed(value, digit)
    one_of(f"{claim['id']}: spread_of", over, tuple(SPREADS))
    if "tolerance" in claim:
        raise UserError(f"{claim['id']}: a spread of {over} is no tolerance: leave `tolerance` out")
    return Printed(value, digit, spread, over)


def tolerance(thesis: Printed, ours: Ours) -> float:
    """Return the difference of two means that their standard errors and rounding explain.

    Args:
        thesis: Printed mean with a spread.
        ours: Our mean.

    Returns:
        Half a unit of the last printed digit, and `ERRORS` standard errors of the difference. The
        thesis' mean has no standard error if its spread is one of single episodes.
    """
    count = SPREADS.get(thesis.over, 0)
    error = (thesis.spread or 0.0) / math.sqrt(count) if count else 0.0
    return thesis.digit / 2 + ERRORS * math.hypot(error, ours.error)


def verdict(thesis: Printed, ours: Ours) -> str:
    """Return the verdict on a printed mean with a spread.

    reproduced: the means differ by no more than their standard errors explain, and ours is known at
    least as well as the printed spread.

    partly: ours is known less well, so that the comparison decides neither way; or single episodes
    hardly show the difference (`NEGLIGIBLE`), though the means do.

    not: otherwise.

    Args:
        thesis: Printed mean with a spread.
        ours: Our mean.

    Returns:
        "reproduced", "partly" or "not".
    """
    assert thesis.spread is not None
    gap = abs(ours.value - thesis.value)
    if gap <= tolerance(thesis, ours):
        is_precise = ERRORS * ours.error <= max(thesis.spread, thesis.digit / 2)
        return "reproduced" if is_precise else "partly"
    negligible = thesis.over == "episodes" and gap < NEGLIGIBLE * thesis.spread
    return "partly" if negligible else "not"


def _digit(text: str, value: float) -> float:
    """Return one unit of the last digit with which a text prints a value; 1 if it doesn't."""
    for match in _PRINTED.finditer(text):
        plain = match.group().replace(",", "")
        digits, _, exponent = plain.partition("e")
        if float(plain) in (value, 100 * value):
            scale = value / float(plain) if value else 1.0
            return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])) * scale
    return 1.0  # a count, of things that the thesis lists

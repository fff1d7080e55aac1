"""HTML and Markdown, made from the content of `report.json` alone."""

from __future__ import annotations

import bisect
import functools
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from socialiq.audit.evidence.outcomes import criterion
from socialiq.audit.profile.fields import QUANTITIES, Range
from socialiq.audit.profile.profile import is_recorded, measured_in, world_of
from socialiq.audit.report import animations, pictures, words
from socialiq.audit.report.documents import losses_decide, shows_angle
from socialiq.audit.report.words import Real, arcs, degrees
from socialiq.audit.verdict.decision import Decision
from socialiq.foreign import Markdown, printable, templates
from socialiq.page.write import core, embedded, program, source_hash
from socialiq.types import Json
from socialiq.worlds.catalogue import KNOWN, base, in_sumo
from socialiq.worlds.road_users import ROAD_USERS


class Replays(NamedTuple):
    """Script that replays episodes in a page, its data as JSON, and the sources that are allowed.

    The page's content security policy allows these sources of scripts.
    """

    program: str
    data: str
    allowed: str


def replays(report: Json) -> Replays | None:
    """Return the replays of a report's episodes; None where none has decisions."""
    rows = [
        {"kind": kind, "number": number, "actions": row["trace"]["actions"]}
        | {name: row[name] for name in ("seed", "r_env", "r_social", "ending", "decisions")}
        for kind, rows in sorted(report["episodes"].items(), reverse=True)
        for number, row in enumerate(rows, 1)
        if row["trace"] and row["trace"]["actions"]
    ]
    scenario = report["declaration"]["scenario"]
    if not rows or scenario["world"] != "intersection":
        return None
    world: Any = world_of(scenario["world"], scenario["options"])
    script = program("watch")
    data = embedded({**core(world.options), "episodes": rows})
    return Replays(script, data, f"{source_hash(script)} 'wasm-unsafe-eval'")


Rows = list[dict[str, str]]  # of a table, with texts by column


VERDICTS = {
    "pass": "Behaves as declared",
    "kept": "Keeps the declared limits, which show no angle",
    "fail": "Does not behave as declared",
    "inconclusive": "Not decided",
}


def number(value: Real | None) -> str:
    """Return three significant digits, at most three decimals, with a typographic minus."""
    if value is None:
        return "–"
    text = f"{round(value, 3):.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return (text if float(text.replace(",", "")) else "0").replace("-", "−")


def percent(share: Real | None) -> str:
    """Return a share as a percentage to one decimal."""
    return "–" if share is None else f"{100 * share:.1f} %".replace("-", "−")


def measured(value: Real | None, share: bool) -> str:
    """Return a value or a change as text.

    Args:
        value: The number; None becomes a dash.
        share: Whether it is a share, which is written as a percentage.
    """
    return percent(value) if share else number(value)


def amount(value: Real, unit: str = "") -> str:
    """Return a mean as text.

    Args:
        value: The mean.
        unit: Its unit; "" for a share, which is written as a percentage.
    """
    return f"{number(value)} {unit}" if unit else percent(value)


_TURNS = (0.0, 45.0, 90.0, 180.0, 270.0)  # degrees
_MEANINGS = (
    "only its own progress counts",
    "its own progress counts more than the ease of the others",
    "its own progress and the ease of the others count alike",
    "the ease of the others counts more than its own progress",
    "only the ease of the others counts",
    "the ease of the others counts, and its own progress counts against it",
    "losing its own progress is all that counts",
    "both its own progress and the ease of the others count against it",
    "hindering the others is all that counts",
    "its own progress counts, and the ease of the others counts against it",
)
"""Meaning of each of `_TURNS`, and of the angles behind it."""


def meaning(angle: Real) -> str:
    """Return the meaning of an angle for a driver."""
    return _MEANINGS[bisect.bisect_left(_TURNS, angle) + bisect.bisect_right(_TURNS, angle) - 1]


OUTCOMES = {"pass": "kept", "fail": "broken", "inconclusive": "not decided"}


def colour(report: Json) -> str:
    """Return the key of `VERDICTS`: "kept" for a pass that doesn't show the angle."""
    decision = report["verdict"]["decision"]
    return "kept" if decision == "pass" and not shows_angle(report) else decision


def between(above: Real | None, below: Real | None) -> str:
    """Return an open range of angles from 0 to 90 degrees in words.

    Args:
        above: Lower end in degrees; None if the range has no lower limit.
        below: Upper end in degrees; None if the range has no upper limit.
    """
    if above is None:
        return "every angle" if below is None else f"below {degrees(below)}"
    return f"above {degrees(above)}" if below is None else f"{degrees(above)} to {degrees(below)}"


def not_excluded(report: Json) -> str:
    """Return the angles that the direction of the driving doesn't exclude, in a sentence."""
    if span(report) is None:
        return ""
    direction = report["tests"]["direction"]
    return f"Angles not excluded: {between(direction['above'], direction['below'])}."


def span(report: Json) -> Range | None:
    """Return the angles of 0 to 90 degrees that the direction doesn't exclude, or None."""
    direction = report["tests"]["direction"]
    if direction is None or not direction["sides"]:
        return None
    above = direction["above"]
    below = direction["below"]
    return (0.0 if above is None else above, 90.0 if below is None else below)


_COLUMNS = ("test", "name", "result", "estimate", "low", "high", "asked for")
_OF_SHARE = ("share", "low", "high")


def tested(report: Json) -> Rows:
    """Return the rows of all tests that decide, in words; `test` is the name in 20 characters."""
    tests = report["tests"]
    declared = report["declaration"]
    units = measured_in(declared["scenario"]["world"])
    regret, direction, character = (tests[key] for key in ("regret", "direction", "character"))
    rows = []

    def add(test: str, name: str, decision: str, limit: str, *ends: str) -> None:
        cells = (test, name, OUTCOMES[decision], *ends, limit)
        rows.append(dict(zip(_COLUMNS, cells, strict=True)))

    angle = degrees(declared["angle"])
    names = "reward below best", f"reward below the best reference driver's at {angle}, per episode"
    if losses_decide(report):
        names = "decision loss", "decision loss at the declared rule, per episode"
    ends = (number(regret[key]) for key in ("regret", "low", "high"))
    add(*names, regret["decision"], f"at most {number(regret['margin'])}", *ends)
    if direction is not None and direction["decision"] is not None:
        name = "direction, by the reference drivers of the angles"
        ends = between(direction["above"], direction["below"]), "", ""
        limit = between(direction["low"], direction["high"])
        add("direction", name, direction["decision"], limit, *ends)
    for side in character["beyond"] if character else ():
        name = f"drives beyond the {side['end']} end of the width"
        limit = f"at most {percent(character['limit'])}"
        ends = (percent(side[key]) for key in _OF_SHARE)
        broken = side["low"] > character["limit"]
        decision = Decision.of(side["high"] <= character["limit"], broken).value
        add(f"beyond, {side['end']}", name, decision, limit, *ends)
    for test in tests["competence"]:
        name = test["name"]
        if is_known(report, name):
            show = functools.partial(amount, unit=units.get(name, ""))
            ends = (show(test[key]) for key in _OF_SHARE)
            limit = f"{test['side']} {show(test['limit'])}"
            add(name.replace("_", " "), criterion(name), test["decision"], limit, *ends)
    return rows


def by_class(report: Json) -> Rows:
    """Return a row for each bound of an effect, by class of road users, in words.

    A class that the world has and that has no bound has a row that says so.
    """
    scenario = report["declaration"]["scenario"]
    of = {name.replace("_", " "): QUANTITIES[name].of for name in measured_in(scenario["world"])}
    rows = [{"class": of[row["test"]], **row} for row in tested(report) if row["test"] in of]
    if not rows:
        return []
    classes = list(dict.fromkeys(of.values()))
    if not in_sumo(scenario["world"]):
        absent = {user.plural for user in ROAD_USERS[1:] if not scenario["options"].get(user.rate)}
        classes = [name for name in classes if name not in absent]
    bounded = {row["class"] for row in rows}
    empty = dict.fromkeys(rows[0], "") | {"name": "no bound is declared"}
    rows += [empty | {"class": name} for name in classes if name not in bounded]
    return sorted(rows, key=lambda row: [*classes, row["class"]].index(row["class"]))


def compatible(report: Json) -> str:
    """Return the angles whose regret is within the margin, or the nearest one, in a sentence."""
    nearest = report["tests"]["rationalised"]
    within = arcs(nearest["arcs"])
    if within != "none":
        return f"In the blue part of the curve it is within the margin: {within}."
    if nearest["arcs"]:
        return "At no angle from 0° to 90° is it within the margin."
    return (
        f"At no angle is it within the margin. It is nearest at {degrees(nearest['least_angle'])} "
        f"(circle), {number(nearest['least'])} below the best, where "
        f"{number(nearest['margin'])} is allowed."
    )


def other_passes(report: Json, most: int = 3) -> str:
    """Return how many other drivers would pass the declaration, in a sentence with some names.

    Args:
        report: Content of `report.json`.
        most: Largest number of names.
    """
    tried = report["discrimination"]
    if not tried["of"]:
        return "There is no other driver that could be judged by this declaration."
    if not tried["would_pass"]:
        return f"None of {tried['of']} other drivers would pass this declaration."
    names = words.names_of(report)
    passed = (row["name"] for row in tried["drivers"] if row["decision"] == "pass")
    passing = [str(names.get(name, name)) for name in passed]
    remaining = f" and {len(passing) - most} more" if len(passing) > most else ""
    which = f": {'; '.join(passing[:most])}{remaining}" if most else ""
    return f"{tried['would_pass']} of {tried['of']} other drivers would pass it too{which}."


def compatible_angles(context: Json) -> str:
    """Return the angles that are compatible with the driving in a context of a rule."""
    return ", ".join(
        degrees(candidate["angle"]) for candidate in context["by_angle"] if candidate["compatible"]
    )


def options(values: Json) -> str:
    """Return the options of a world in one line."""
    return ", ".join(f"{name} = {value}" for name, value in values.items()) or "defaults"


def code(text: str) -> Markdown:
    """Return a fenced block of code, in which Markdown has no markup; no text closes it."""
    longest = max(map(len, re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return Markdown(f"{fence}\n{printable(text)}\n{fence}")


def blank(who: str) -> Markdown:
    """Return a marked place that people have to fill."""
    return Markdown(f"> **[ blank ]** to be filled by {who}")


FILTERS: dict[str, Callable[..., str]] = {
    function.__name__: function
    for function in (
        *(number, percent, amount, criterion, measured, degrees, arcs, meaning, options),
        *(compatible_angles, words.odds),
    )
}
FILTERS |= {"outcome": OUTCOMES.__getitem__, "code": code}


def html(report: Json) -> str:
    """Return one self-contained page; all user-provided text is escaped.

    Its only script replays episodes of the intersection, and is named by hash in the page's policy.
    """
    return _rendered(
        report,
        "report.html.j2",
        means=pictures.means(report),
        single=pictures.episodes(report),
        angles=pictures.angles(report),
        moving=animations.moving(report),
        replays=replays(report),
    )


def markdown(report: Json, template: str = "report.md.j2", **variables: Any) -> str:
    """Return a page of Markdown by a template and further variables; all values are escaped.

    Args:
        report: Content of `report.json`.
        template: Name of the template.
        **variables: Further variables of the template.
    """
    return _rendered(report, template, most=10_000, **variables)


def _rendered(report: Json, template: str, most: int = 0, **variables: Any) -> str:
    """Return a page by its template.

    Args:
        report: Content of `report.json`.
        template: Name of the template.
        most: Largest number of characters of a value in Markdown; 0 for a page in HTML.
        **variables: Further variables of the template.
    """
    pages = templates("socialiq.audit.report", most=most)
    names = words.names_of(report)
    pages.filters.update(FILTERS)
    pages.globals.update(is_known=is_known, blank=blank)
    drivers = report["discrimination"]["drivers"]
    return pages.get_template(template).render(
        report=report,
        name_of=lambda name: names.get(name, name),
        would_pass={driver["name"]: driver["decision"] for driver in drivers},
        other_passes=other_passes,
        compatible=compatible(report),
        colour=colour(report),
        headline=VERDICTS[colour(report)],
        not_excluded=not_excluded(report),
        span=span(report),
        tested=tested(report),
        by_class=by_class(report),
        units=measured_in(report["declaration"]["scenario"]["world"]),
        results={words: decision for decision, words in OUTCOMES.items()},
        **variables,
    )


def is_known(report: Json, criterion: str) -> bool:
    """Whether the world reports the event of a criterion; an environment doesn't report fault.

    Args:
        report: Content of `report.json`.
        criterion: Name of a criterion of the floor, or of a quantity, which is always known.
    """
    world = report["declaration"]["scenario"]["world"]
    return criterion != "struck" or base(world) in KNOWN or is_recorded(world)

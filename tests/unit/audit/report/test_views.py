"""Pages are made from the report alone, and no text from outside in them is markup."""

import base64
import hashlib
import html.parser
import json
import re

import pytest

from socialiq.audit.report.documents import claims, mermaid
from socialiq.audit.report.folder import views_of
from socialiq.audit.report.pictures import front
from socialiq.audit.report.views import (
    arcs,
    colour,
    compatible,
    degrees,
    markdown,
    meaning,
    number,
    other_passes,
    percent,
    replays,
)
from socialiq.audit.report.views import html as page
from socialiq.audit.report.views import tested as rows_of
from socialiq.audit.report.words import names_of
from socialiq.page.webassembly.layout import layout
from socialiq.to_json import to_json
from socialiq.worlds.intersection.options import Options

VOID = {"meta", "link", "br", "img", "input"}

BESIDE = ("credibility.md", "ml-bom.cdx.json")
"""Files of the report's folder that the page links to."""


class Reader(html.parser.HTMLParser):
    """Collects tags and attributes, and whether every tag is closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def drawn(report):
    return page(report)


def test_the_page_is_whole_and_needs_nothing_else(drawn):
    found = Reader(drawn)
    assert not found.open
    assert not {"script", "iframe", "object", "link", "form", "base"} & set(found.tags)
    for name, value in found.attributes:
        assert not name.startswith("on"), name
        if name in ("src", "href", "action"):
            assert value.startswith(("#", "data:")) or value in BESIDE, value
    assert found.tags.count("svg") == 10  # the span, three pictures, and six episodes
    assert "http" not in re.sub(r"http-equiv", "", drawn)
    assert "url(" not in drawn.replace("url(#", "")


def test_names_from_outside_are_no_markup(drawn, report):
    assert "<script>" not in drawn and "&lt;script&gt;" in drawn
    text = markdown(report)
    # A fenced block of code holds the command as it is: there Markdown reads no markup.
    lines = re.sub("^(```+)\n.*?^\\1$", "", text, flags=re.M | re.S).splitlines()
    assert not any("<script>" in line or "`x`" in line or "[y]" in line for line in lines)


def test_the_first_words_are_the_verdict(drawn, report):
    visible = re.sub(r"<[^>]+>", " ", drawn.split("</style>")[1])
    assert report["verdict"]["reason"] in visible[:900]
    assert markdown(report).splitlines()[2].startswith(("**Behaves", "**Does not", "**Not"))


def test_no_number_of_the_tests_is_missing(drawn, report):
    text = markdown(report)
    regret = report["tests"]["regret"]
    for value in (regret["regret"], regret["low"], regret["high"], regret["margin"]):
        assert number(value) in drawn and number(value) in text
    for one in report["references"]:
        assert one["name"] in drawn and names_of(report)[one["name"]] in drawn
    for limit in report["limits"]:
        assert limit in text
    for value in report["hashes"].values():
        assert value in drawn and value in text


def test_pages_come_from_the_file_as_from_memory(report, drawn):
    again = json.loads(json.dumps(report))
    assert page(again) == drawn and markdown(again) == markdown(report)


def test_pages_without_an_angle_or_strata(plain):
    plain["tests"]["alpha_hat"] = None
    plain["strata"] = []
    assert "No angle α̂:" in page(plain)
    assert "No angle α̂:" in markdown(plain)


def test_the_front_by_hand():
    points = [(0.0, 2.0), (1.9, 0.0), (1.5, 1.5), (0.5, 1.0), (2.0, -3.0), (2.0, -2.0)]
    assert front(points) == [(2.0, -2.0), (1.9, 0.0), (1.5, 1.5), (0.0, 2.0)]


def test_words():
    assert number(-0.12345) == "−0.123" and number(12345.6) == "12,346" and number(-0.0) == "0"
    assert number(None) == "–" and percent(0.125) == "12.5 %" and degrees(141.52) == "141.5°"
    assert meaning(0.0) == "only its own progress counts"
    assert meaning(30.0).startswith("its own progress counts more")
    assert meaning(135.0).endswith("its own progress counts against it")
    assert meaning(315.0).endswith("the ease of the others counts against it")


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ([], "none"),
        ([(2.6, 191.2)], "2.6° to 90°"),
        ([(281.0, 406.0)], "0° to 46°"),
        ([(110.0, 260.5)], "none"),
        ([(0.0, 360.0)], "0° to 90°"),
        ([(80.0, 375.0)], "0° to 15°, 80° to 90°"),
        ([(10.0, 20.0), (30.0, 40.5)], "10° to 20°, 30° to 40.5°"),
    ],
)
def test_ranges_of_angles_are_within_0_to_90(plain, ends, words):
    """Before, a report named angles such as 191.2 degrees, which no one can declare."""
    ranges = [{"low": low, "high": high} for low, high in ends]
    assert arcs(ranges) == words
    plain["tests"]["rationalised"]["arcs"] = ranges
    said = f"At no angle{' from 0° to 90°' * bool(ends)} is it" if words == "none" else words
    assert said in compatible(plain)


def test_each_end_of_the_width_has_a_result_of_its_own(plain):
    """Before, the end at 0 % was called broken because of the other one."""
    shares = {"count": 0, "share": 0.0, "low": 0.0, "high": 0.004}
    ends = [shares | {"end": "egoistic"}, shares | {"end": "social", "low": 0.2, "high": 0.3}]
    plain["tests"]["character"] = {"decision": "fail", "limit": 0.075, "beyond": ends}
    rows = {row["test"]: row["result"] for row in rows_of(plain) if "beyond" in row["test"]}
    assert rows == {"beyond, egoistic": "kept", "beyond, social": "broken"}
    ends[1]["low"] = 0.05
    assert {row["result"] for row in rows_of(plain) if "social" in row["test"]} == {"not decided"}


def test_a_pass_that_shows_no_angle_is_not_green(plain):
    plain["verdict"]["decision"] = "pass"
    plain["discrimination"]["trivial_passes"] = []
    direction = plain["tests"]["direction"] or {"sides": []}
    plain["tests"]["direction"] = direction | {"decision": "pass"}
    assert colour(plain) == "pass" and '<div class="verdict pass">' in page(plain)
    plain["tests"]["direction"] = direction | {"decision": None}
    assert colour(plain) == "kept" and '<div class="verdict kept">' in page(plain)


def test_a_page_has_one_note_first_and_folds_the_rest(plain):
    notes = [{"about": "look", "text": f"Note {name}."} for name in "ABC"]
    for count, folded in enumerate((None, None, "1 more note<", "2 more notes<")):
        plain["caveats"] = notes[:count]
        first, _, rest = page(plain).partition("<details")
        assert ("Note A." in first) == (count > 0)
        assert folded in rest if folded else not rest
        assert not any(note["text"] in first for note in notes[1:])


def test_the_first_screen_has_no_name_of_the_code(drawn):
    first = re.sub(r"<[^>]+>", " ", drawn.split("</style>", 1)[1].split("What was tested")[0])
    for name in ("R_env", "R_social", "optimum_", "trivial_", "set_", "α̂"):
        assert name not in first


def test_other_drivers_are_counted_and_named(plain):
    rows = plain["discrimination"]["drivers"]
    for one in rows:
        one["decision"] = "fail"
    plain["discrimination"]["would_pass"] = 0
    assert other_passes(plain) == f"None of {len(rows)} other drivers would pass this declaration."
    rows[-1]["decision"], rows[0]["decision"] = "pass", "pass"
    plain["discrimination"]["would_pass"] = 2
    named = f"{names_of(plain)[rows[0]['name']]}; chooses at random"
    assert other_passes(plain) == f"2 of {len(rows)} other drivers would pass it too: {named}."
    assert other_passes(plain, 1).endswith(" and 1 more.")
    assert other_passes(plain, 0) == f"2 of {len(rows)} other drivers would pass it too."
    plain["discrimination"] = {"would_pass": 0, "of": 0, "trivial_passes": [], "drivers": []}
    assert other_passes(plain).startswith("There is no other driver")


def test_a_report_that_names_unknown_drivers_has_pages_too(plain):
    plain["tests"]["regret"]["best"] = "unknown_driver"
    plain["discrimination"]["drivers"][0] |= {"name": "other_driver", "decision": "pass"}
    plain["discrimination"]["would_pass"] = 1
    assert "unknown_driver" in page(plain) and "other_driver" in page(plain)
    assert "unknown\\_driver" in markdown(plain)


BLANK = "**[ blank ]**"


@pytest.fixture(scope="module")
def pages(report):
    return {name: content.decode() for name, content in views_of(report).items()}


def sections(page):
    return dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))


def test_annex_iv_has_its_nine_points(pages, report):
    found = sections(pages["annex-iv.md"])
    assert [name.split(".")[0] for name in found] == [str(number) for number in range(1, 10)]
    assert all(BLANK in text for text in found.values())
    for point in ("5", "7", "8", "9"):
        text = next(text for name, text in found.items() if name.startswith(point))
        assert len([line for line in text.splitlines() if line]) == 1
    assert report["hashes"]["policy"] in pages["annex-iv.md"]


def test_nist_has_its_four_functions(pages):
    found = sections(pages["nist-ai-rmf.md"])
    assert list(found) == ["Govern", "Map", "Measure", "Manage"]
    assert all(BLANK in text for text in found.values())


def test_nothing_states_conformity_and_no_outside_text_is_markup(pages):
    for name in ("annex-iv.md", "nist-ai-rmf.md", "safety-case.md"):
        assert "<script>" not in pages[name]
        assert not re.search(r"\b(conforms|complies|is compliant|certif)", pages[name])


@pytest.mark.parametrize(
    ("decision", "status"),
    [("pass", "supported"), ("fail", "contradicted"), ("inconclusive", "undecided")],
)
def test_claims_follow_the_verdict(plain, decision, status):
    plain["verdict"]["decision"] = decision
    plain["tests"]["direction"]["decision"], plain["discrimination"]["trivial_passes"] = "pass", []
    tree = {one.id: one for one in claims(plain)}
    assert tree["G1"].status == status
    assert {tree[name].status for name in ("G0", "G2", "G3")} == {"to be filled"}
    below = {name for one in tree.values() for name in one.below}
    assert below == set(tree) - {"G0"}


def test_the_tree_is_drawn_whole(plain, pages):
    tree = claims(plain)
    drawn = mermaid(tree)
    assert drawn in pages["safety-case.md"]
    for one in tree:
        assert f"{one.id}[" in drawn
        assert all(f"{one.id} --> {name}" in drawn for name in one.below)
    assert [one["id"] for one in json.loads(pages["claims.json"])] == [one.id for one in tree]


def at_intersection(report, **options):
    """A report as if of the intersection, with decisions that end no element."""
    report["declaration"]["scenario"] |= {"world": "intersection", "options": options}
    for rows in report["episodes"].values():
        for row in rows:
            row["trace"]["actions"] = "0122"
    return report


def test_in_a_gridworld_there_are_none_and_no_script(plain):
    assert replays(plain) is None
    assert "<script" not in page(plain) and "script-src" not in page(plain)


def test_its_data_are_the_scenario_and_the_episodes_worst_first(plain):
    found = replays(at_intersection(plain, spawn_probability=0.9))
    assert found is not None
    data = json.loads(found.data)
    assert data["layout"] == to_json(layout(Options(spawn_probability=0.9)))
    rows = [(row["kind"], row["number"], row["actions"]) for row in data["episodes"]]
    numbers = (1, 2, 3)
    assert rows == [(kind, one, "0122") for kind in ("worst", "median") for one in numbers]
    worst = plain["episodes"]["worst"][0]
    assert data["episodes"][0]["r_env"] == worst["r_env"]
    assert data["episodes"][0]["seed"] == worst["seed"]


def test_an_episode_that_was_not_driven_again_is_left_out(plain):
    report = at_intersection(plain)
    report["episodes"]["worst"][1]["trace"] = None
    found = replays(report)
    assert found is not None
    assert len(json.loads(found.data)["episodes"]) == 5


def test_the_page_allows_its_program_by_hash_and_grows_by_less_than_600_kb(plain):
    before = page(plain)
    after = page(at_intersection(plain))
    (script,) = re.findall(r"<script>(.*?)</script>", after, re.S)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}' 'wasm-unsafe-eval'" in after
    assert "connect-src" not in after and "http" not in re.sub(
        "http-equiv|http://www.w3", "", after
    )
    assert len(after.encode()) - len(before.encode()) < 600_000

"""Pages are made from the report alone, and no text from outside in them is markup."""

import html.parser
import json
import re

import pytest

from socialiq.audit.report.pictures import front
from socialiq.audit.report.views import arcs, degrees, markdown, meaning, number, others, percent
from socialiq.audit.report.views import html as page
from socialiq.audit.report.words import names_of

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
    assert found.tags.count("svg") == 9  # three pictures, and six episodes
    assert "http" not in re.sub(r"http-equiv", "", drawn)
    assert "url(" not in drawn.replace("url(#", "")


def test_names_from_outside_are_no_markup(drawn, report):
    assert "<script>" not in drawn and "&lt;script&gt;" in drawn
    text = markdown(report)
    # An indented block of code holds the command as it is: there Markdown reads no markup.
    lines = [line for line in text.splitlines() if not line.startswith("    ")]
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
    assert arcs([{"low": 281.0, "high": 406.0}]) == "−79° to 46°"
    assert arcs([{"low": 110.0, "high": 260.5}]) == "110° to 260.5°"
    assert arcs([{"low": 0.0, "high": 360.0}]) == "every angle" and arcs([]) == "none"
    assert meaning(0.0) == "only its own progress counts"
    assert meaning(30.0).startswith("its own progress counts more")
    assert meaning(135.0).endswith("its own progress counts against it")
    assert meaning(315.0).endswith("the ease of the others counts against it")


def test_the_first_screen_has_no_name_of_the_code(drawn):
    first = re.sub(r"<[^>]+>", " ", drawn.split("</style>", 1)[1].split("What was tested")[0])
    for name in ("R_env", "R_social", "optimum_", "trivial_", "set_", "α̂"):
        assert name not in first


def test_other_drivers_are_counted_and_named(plain):
    rows = plain["discrimination"]["drivers"]
    for one in rows:
        one["decision"] = "fail"
    plain["discrimination"]["would_pass"] = 0
    assert others(plain) == f"None of {len(rows)} other drivers would pass this declaration."
    rows[-1]["decision"], rows[0]["decision"] = "pass", "pass"
    plain["discrimination"]["would_pass"] = 2
    named = f"{names_of(plain)[rows[0]['name']]}; chooses at random"
    assert others(plain) == f"2 of {len(rows)} other drivers would pass it too: {named}."
    assert others(plain, 1).endswith(" and 1 more.")
    assert others(plain, 0) == f"2 of {len(rows)} other drivers would pass it too."
    plain["discrimination"] = {"would_pass": 0, "of": 0, "excludes_nothing": False, "drivers": []}
    assert others(plain).startswith("There is no other driver")


def test_a_report_that_names_unknown_drivers_has_pages_too(plain):
    plain["tests"]["regret"]["best"] = "unknown_driver"
    plain["discrimination"]["drivers"][0] |= {"name": "other_driver", "decision": "pass"}
    plain["discrimination"]["would_pass"] = 1
    assert "unknown_driver" in page(plain) and "other_driver" in page(plain)
    assert "unknown\\_driver" in markdown(plain)

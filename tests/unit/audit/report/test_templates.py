"""Pages under other frames' headings: filled where there is evidence, blank elsewhere."""

import json
import re

import pytest

from socialiq.audit.report.documents import claims, mermaid
from socialiq.audit.report.folder import views_of

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

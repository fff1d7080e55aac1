"""The page that a server sends."""

import base64
import hashlib
import json
import re

import pytest

from socialiq.page.write import ASSETS, program
from socialiq.view import View
from socialiq.view.server import OWN, front

HOSTILE = "</script><script>alert(1)</script>"


@pytest.fixture(scope="module")
def made():
    return front(View("policy", HOSTILE, HOSTILE, {"name": HOSTILE}), "ws://127.0.0.1:1/t/decide")


@pytest.fixture(scope="module")
def text(made):
    return made.text


def part(text, start, end):
    return text.split(start, 1)[1].split(end, 1)[0]


def test_its_policy_allows_its_own_script_and_its_server_alone(made, text):
    policy = made.policy
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    assert rules["connect-src"] == "'self' ws://127.0.0.1:1/t/decide"
    for name, start, end in (
        ("style-src", "<style>", "</style>"),
        ("script-src", '<script id="program">', "</script>"),
    ):
        digest = hashlib.sha256(part(text, start, end).encode()).digest()
        assert f"'sha256-{base64.b64encode(digest).decode()}'" in rules[name]
    assert "unsafe-inline" not in policy and "*" not in policy


def test_names_of_files_stay_text(text):
    assert text.count("<script") == 2 and "alert(1)</" not in text
    data = json.loads(part(text, '<script type="application/json" id="data">', "</script>"))
    assert data["shown"]["name"] == HOSTILE


def test_nothing_is_asked_of_another_place(text):
    assert not re.search(r'src="', text) and set(re.findall(r'href="([^"]*)"', text)) == {"dial"}
    assert not re.findall(r"https?://(?!www\.w3\.org/2000/svg)", text)


@pytest.mark.parametrize("path", sorted(OWN.glob("*.js")), ids=lambda path: path.stem)
def test_scripts_stay_short_and_their_names_their_own(path):
    assert len(path.read_text().splitlines()) <= 320
    assert not (ASSETS / path.name).exists()
    assert f"const script_{path.stem} = (" in program("opened", OWN)


def test_what_a_script_imports_is_exported():
    for path in OWN.glob("*.js"):
        for names, other in re.findall(
            r'^import \{ ([^}]+) \} from "([^"]+)";$', path.read_text(), re.M
        ):
            exported = re.findall(
                r"^export (?:async )?(?:function|class|const) (\w+)",
                (OWN / other).read_text(),
                re.M,
            )
            assert set(names.split(", ")) <= set(exported), (path.name, other)


def test_its_parts_have_the_classes_that_the_pages_styles_know():
    style = (ASSETS / "style.css").read_text() + (OWN / "opened.css").read_text()
    for path in OWN.glob("*.html"):
        for names in re.findall(r'class="([^"]+)"', path.read_text()):
            for name in set(names.split()) - {"rates"}:
                assert f".{name}" in style, (path.name, name)

"""The page that a server sends."""

import asyncio
import base64
import hashlib
import json
import re

import pytest

from socialiq.page.write import ASSETS, program
from socialiq.view import View
from socialiq.view.server import OWN, TOKEN_BYTES, Guard, front

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


TOKEN = "a-token"
HOST, ORIGIN = b"127.0.0.1:8000", b"http://127.0.0.1:8000"


async def inner(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"shown"})


def asked(path="/a-token/", kind="http", method="GET", **headers):
    """Return what is sent back; headers are named with _ for -."""
    given = {"host": HOST} | headers
    pairs = [(name.replace("_", "-").encode(), value) for name, value in given.items()]
    scope = {"type": kind, "method": method, "path": path, "headers": pairs}
    sent = []

    async def receive():
        return {"type": f"{kind}.connect"}

    async def send(message):
        sent.append(message)

    asyncio.run(Guard(inner, 8000, TOKEN)(scope, receive, send))
    return sent


def status(**request):
    return asked(**request)[0]["status"]


def test_its_own_page_is_answered_with_headers_that_keep_others_out():
    sent = asked(origin=ORIGIN, sec_fetch_site=b"same-origin")
    assert sent[0]["status"] == 200 and sent[1]["body"] == b"shown"
    headers = dict(sent[0]["headers"])
    assert headers[b"cache-control"] == b"no-store" and headers[b"x-frame-options"] == b"DENY"
    assert headers[b"referrer-policy"] == b"no-referrer"
    assert headers[b"cross-origin-resource-policy"] == b"same-origin"


@pytest.mark.parametrize(
    "host",
    [b"localhost:8000", b"evil.example", b"evil.example:8000", b"127.0.0.1", b"0.0.0.0:8000"],
)
def test_a_name_that_leads_here_is_no_host_of_ours(host):
    assert status(host=host) == 421


def test_two_hosts_or_none_are_refused():
    pair = [(b"host", HOST), (b"host", HOST)]
    for headers in (pair, []):
        sent = []

        async def send(message, sent=sent):
            sent.append(message)

        scope = {"type": "http", "method": "GET", "path": "/a-token/", "headers": headers}
        asyncio.run(Guard(inner, 8000, TOKEN)(scope, None, send))
        assert sent[0]["status"] == 421


@pytest.mark.parametrize("origin", [b"http://evil.example", b"null", b"http://127.0.0.1:8001", b""])
def test_another_origin_is_refused(origin):
    assert status(origin=origin) == 403


@pytest.mark.parametrize("site", [b"cross-site", b"same-site"])
def test_a_request_that_another_site_caused_is_refused(site):
    assert status(sec_fetch_site=site) == 403


@pytest.mark.parametrize(
    "path",
    ["/", "/a-toke/", "/a-token2/", "//a-token/", "/A-TOKEN/", "/part/0", "/é", "/../a-token/"],
)
def test_without_the_token_nothing_is_there(path):
    assert status(path=path) == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_nothing_can_be_changed(method):
    assert status(method=method) == 405


def test_a_websocket_must_name_its_origin():
    for headers in ({}, {"origin": b"http://evil.example"}):
        (sent,) = asked(kind="websocket", path="/a-token/decide", **headers)
        assert sent["type"] == "websocket.close" and sent["code"] == 1008
    assert asked(kind="websocket", path="/a-token/decide", origin=ORIGIN)[1]["body"] == b"shown"


def test_tokens_are_long():
    assert 8 * TOKEN_BYTES >= 192

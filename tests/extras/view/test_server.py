"""The local server on the wire: what it answers, and what it refuses."""

import contextlib
import http.client
import json
import urllib.parse

import pytest
from tests.patience import HANG

pytest.importorskip("starlette", reason="extra `web` is not installed")
pytest.importorskip("uvicorn", reason="extra `web` is not installed")
pytest.importorskip("websockets", reason="extra `web` is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect


@pytest.fixture(scope="module")
def address(serving):
    with serving("idm") as found:
        yield urllib.parse.urlsplit(found)


def answer(address, path, method="GET", **headers):
    """Return status, headers and body of one request, its path sent as it is."""
    connection = http.client.HTTPConnection(address.hostname, address.port, timeout=HANG)
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    with contextlib.closing(connection):
        connection.request(method, path, headers=given)
        found = connection.getresponse()
        return found.status, dict(found.getheaders()), found.read()


def test_the_page_comes_with_its_policy_and_is_kept_nowhere(address):
    status, headers, body = answer(address, address.path)
    assert status == 200 and b"<title>idm - socialiq</title>" in body
    assert "default-src 'none'" in headers["content-security-policy"]
    assert headers["cache-control"] == "no-store" and "server" not in headers
    status, _, body = answer(address, f"{address.path}dial")
    assert status == 200 and b"Turn the dial" in body


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "localhost"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
    ],
)
def test_other_hosts_and_origins_are_refused(address, headers):
    status, _, body = answer(address, address.path, **headers)
    assert status in (403, 421) and b"idm" not in body


@pytest.mark.parametrize("path", ["/", "/part/0", "/favicon.ico", "/wrong-token/", "/dial", "//"])
def test_without_the_token_nothing_is_answered(address, path):
    assert answer(address, path)[0] == 404


@pytest.mark.parametrize(
    "path",
    [
        "../../etc/passwd",
        "%2e%2e/%2e%2e/etc/passwd",
        "..%2f..%2fetc/passwd",
        "/etc/passwd",
        "page.js",
        "static/a.css",
        "part/0",
        "part/-1",
        "part/..%2f0",
        "part/99999999999999999999",
    ],
)
def test_only_the_pages_own_paths_exist(address, path):
    status, _, body = answer(address, address.path + path)
    assert status == 404 and b"root:" not in body and len(body) < 200


def test_nothing_can_be_written(address):
    assert answer(address, address.path, method="POST")[0] == 405


def place_of(address, path="decide"):
    return f"ws://{address.netloc}{address.path}{path}"


def test_a_websocket_of_another_origin_or_without_the_token_is_refused(address):
    own = f"http://{address.netloc}"
    for place, origin in (
        (place_of(address), "http://evil.example"),
        (place_of(address), None),
        (f"ws://{address.netloc}/decide", own),
        (place_of(address, "part/0"), own),
    ):
        with pytest.raises(InvalidStatus) as refusal, connect(place, origin=origin):
            pass
        assert refusal.value.response.status_code == 403


def test_it_decides_refuses_bad_questions_and_a_second_tab(address):
    own = f"http://{address.netloc}"
    with connect(place_of(address), origin=own) as tab:
        tab.send(json.dumps({"number": 7, "observations": [[0.0] * 70] * 2, "decisions": [0, 0]}))
        found = json.loads(tab.recv(timeout=HANG))
        assert found["number"] == 7 and len(found["actions"]) == 2
        for bad in (
            "no JSON",
            b"bytes",
            "[1]",
            "{}",
            '{"number": 1}',
            "[" * 5000,
            '{"number": 1e999}',
        ):
            tab.send(bad)
            fault = json.loads(tab.recv(timeout=HANG))["fault"]
            assert "\n" not in fault and "reload it" in fault
        with connect(place_of(address), origin=own) as second:
            with pytest.raises(ConnectionClosed) as closed:
                second.recv(timeout=HANG)
            assert closed.value.rcvd.code == 4001
        tab.send(json.dumps({"number": 8, "observations": [[0.0] * 70], "decisions": [0]}))
        assert json.loads(tab.recv(timeout=HANG))["number"] == 8
    with connect(place_of(address), origin=own) as later:
        later.send(json.dumps({"number": 1, "observations": [[0.0] * 70], "decisions": [0]}))
        assert json.loads(later.recv(timeout=HANG))["actions"]

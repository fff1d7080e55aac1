"""The page as one file."""

import base64
import hashlib
import json
import re

import pytest

from socialiq.cli.main import main
from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.content import curve
from socialiq.page.webassembly.replay import CORE
from socialiq.page.write import page
from socialiq.storage import packaged_results


@pytest.fixture(scope="module")
def text():
    return page()


def part(text, start, end):
    return text.split(start, 1)[1].split(end, 1)[0]


def test_its_policy_names_its_program_and_its_styles_and_allows_no_request(text):
    policy = part(text, 'Content-Security-Policy" content="', '"')
    assert "default-src 'none'" in policy and "connect-src" not in policy and "http" not in policy
    for start, end in (("<style>", "</style>"), ('<script id="program">', "</script>")):
        digest = hashlib.sha256(part(text, start, end).encode()).digest()
        assert f"'sha256-{base64.b64encode(digest).decode()}'" in policy


def test_it_is_below_a_megabyte_and_names_no_other_place(text):
    assert len(text.encode()) < 1_000_000
    assert not re.search(r'(src|href)="', text)
    assert not re.findall(r"https?://(?!www\.w3\.org/2000/svg)", text)


def test_its_data_are_the_core_the_dial_and_the_curve(text):
    data = json.loads(part(text, '<script type="application/json" id="data">', "</script>"))
    assert base64.b64decode(data["core"]) == CORE.read_bytes()
    dial = packaged_results() / "intersection-dial" / "dial.safetensors"
    assert base64.b64decode(data["dial"]) == dial.read_bytes()
    assert len(data["layout"]["lanes"]) == 20


def test_the_curve_is_that_of_the_study():
    points = curve()
    dial = DialPolicy.load(packaged_results() / "intersection-dial" / "dial.safetensors")
    assert [point["asked"] for point in points] == [5.0 * number for number in range(19)]
    assert dial.provenance["numbers"]["seed"] == 50
    assert points[0]["env"][0] == pytest.approx(8.737962)
    for point in points:
        for mean, low, high in (point["env"], point["social"]):
            assert low < mean < high


def test_the_command_writes_it_once(tmp_path, capsys):
    assert main(["page", "--out", str(tmp_path / "site")]) == 0
    assert (tmp_path / "site" / "index.html").stat().st_size > 300_000
    assert main(["page", "--out", str(tmp_path / "site")]) == 2
    assert "exists already" in capsys.readouterr().err

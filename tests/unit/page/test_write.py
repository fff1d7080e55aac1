"""The page as one file."""

import base64
import dataclasses
import hashlib
import json
import re

import jax
import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.data import (
    CAUSED_STUDY,
    FAMILY,
    FLEET_STUDY,
    SEED,
    STUDY,
    measured,
    shipped_dial,
)
from socialiq.page.webassembly.layout import CORE
from socialiq.page.write import ASSETS, page, program
from socialiq.storage import packaged_results

DIAL = packaged_results() / STUDY / f"{FAMILY}.safetensors"
CAUSED_DIAL = packaged_results() / CAUSED_STUDY / "dial.safetensors"
FLEET_DIAL = packaged_results() / FLEET_STUDY / "dial.safetensors"


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


def test_it_is_small_beside_its_dials_and_names_no_other_place(text):
    dials = sum(4 * len(path.read_bytes()) / 3 for path in (DIAL, CAUSED_DIAL, FLEET_DIAL))
    assert len(text.encode()) < 350_000 + dials
    assert not re.search(r'(src|href)="', text)
    assert not re.findall(r"https?://(?!www\.w3\.org/2000/svg)", text)


def test_its_data_are_the_core_the_dial_and_the_curve(text):
    data = json.loads(part(text, '<script type="application/json" id="data">', "</script>"))
    assert base64.b64decode(data["core"]) == CORE.read_bytes()
    files = [base64.b64decode(dial["dial"]) for dial in data["dials"]]
    assert files == [path.read_bytes() for path in (DIAL, CAUSED_DIAL, FLEET_DIAL)]
    assert [len(dial["curve"]) for dial in data["dials"]] == [19, 7, 0]
    assert len(data["layout"]["lanes"]) == 20


def test_the_curve_is_that_of_the_study():
    points = shipped_dial().curve
    assert [point.asked for point in points] == [5.0 * number for number in range(19)]
    assert DialPolicy.load(DIAL).provenance["numbers"]["seed"] == SEED
    assert points[0].env[0] == pytest.approx(8.914123)
    for point in points:
        for mean, low, high in (point.env, point.social):
            assert low < mean < high


def test_a_curve_that_is_measured_agrees_with_that_of_the_study():
    dial = DialPolicy.load(DIAL)
    (point,) = measured(dial, 45, 45, episodes=200)
    known = next(one for one in shipped_dial().curve if one.asked == 45.0)
    assert abs(point.env[0] - known.env[0]) < 2 * (point.env[2] - point.env[1])
    assert abs(point.social[0] - known.social[0]) < 2 * (point.social[2] - point.social[1])


def test_the_command_writes_it_once(tmp_path, capsys):
    assert main(["page", "--out", str(tmp_path / "site")]) == 0
    assert (tmp_path / "site" / "index.html").stat().st_size > 300_000
    assert main(["page", "--out", str(tmp_path / "site")]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_dial_of_ones_own_turns_in_its_range_with_a_curve_of_its_own(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("socialiq.page.data.EPISODES", 10)
    own = dataclasses.replace(DialPolicy.load(DIAL), low=7.5, high=21.0)
    own.save(tmp_path / "own & mine.safetensors")
    words = ["page", "--dial", str(tmp_path / "own & mine.safetensors"), "--out"]
    words.append(str(tmp_path / "site"))
    assert main(words) == 0
    written = (tmp_path / "site" / "index.html").read_text()
    data = json.loads(part(written, '<script type="application/json" id="data">', "</script>"))
    (dial,) = data["dials"]
    assert dial["range"] == [8, 21]
    assert [point["asked"] for point in dial["curve"]] == [8.0, 10.0, 15.0, 20.0, 21.0]
    assert "own &amp; mine.safetensors" in written and "seeds 1 to 10" in written
    assert main(words) == 2 and "exists already" in capsys.readouterr().err


def other_world(path):
    network = DialNetwork.initialise(jax.random.key(0), 5, (4,), 4)
    DialPolicy.of(network, 1.0, 0.0, 90.0, {}).save(path)


def damaged(path):
    content = bytearray(DIAL.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def truncated(path):
    path.write_bytes(DIAL.read_bytes()[:-1000])


def not_a_number(path):
    dial = DialPolicy.load(DIAL)
    weights = (dial.turned.weights[0] * np.float32("nan"), *dial.turned.weights[1:])
    turned = dataclasses.replace(dial.turned, weights=weights)
    dataclasses.replace(dial, turned=turned).save(path)


def another_range(path):
    dataclasses.replace(DialPolicy.load(DIAL), low=100.0, high=120.0).save(path)


def no_dial(path):
    DialPolicy.load(DIAL).at(0.0).save(path)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (other_world, "takes 5 features and 4 actions"),
        (damaged, "damaged"),
        (truncated, "is damaged or not a dial file: restore it or make it again"),
        (not_a_number, "has a weight that is not a finite number: make the file again"),
        (another_range, "the page turns from 0 to 90"),
        (no_dial, "dial"),
        (lambda path: path.mkdir(), "is a folder"),
    ],
)
def test_another_file_is_refused_in_one_line(made, said, tmp_path, capsys):
    made(tmp_path / "dial.safetensors")
    words = ["page", "--dial", str(tmp_path / "dial.safetensors"), "--out", str(tmp_path / "site")]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (tmp_path / "site").exists()


STARTS = ("page", "watch")


def held(start):
    return re.findall(r"^const script_(\w+) = \(", program(start), re.M)


def test_the_programs_hold_every_script():
    assert {name for start in STARTS for name in held(start)} == {
        path.stem for path in ASSETS.glob("*.js")
    }


@pytest.mark.parametrize("start", STARTS)
def test_a_program_holds_a_script_once_and_no_module_syntax(start):
    assert len(held(start)) == len({*held(start)})
    assert not re.search(r"^\s*(import|export)\b", program(start), re.M)


@pytest.mark.parametrize("start", STARTS)
def test_a_script_comes_after_those_it_imports(start):
    text = program(start)
    for one, other in re.findall(r"const \{ [^}]+ \} = (script_\w+);()", text):
        assert text.index(f"const {one} = (") < text.index(f" = {one};") and other == ""


@pytest.mark.parametrize("start", STARTS)
def test_nothing_in_it_ends_its_element(start):
    assert "</script" not in program(start) and "<!--" not in program(start)


def test_scripts_stay_short():
    for path in ASSETS.glob("*.js"):
        assert len(path.read_text().splitlines()) <= 320, path

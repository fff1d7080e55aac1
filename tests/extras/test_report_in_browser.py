"""The report opened by a real browser, at the width of a phone and of a desk."""

import datetime
import json
import re
import shutil
import subprocess

import pytest

from socialiq.audit.profile import Margin
from socialiq.audit.template import new
from socialiq.cli.main import main
from socialiq.policies.native import save_table
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.experts import expert_policy
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy

BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
BROWSER = next((found for name in BROWSERS if (found := shutil.which(name))), "")
PROBE = """<script>
const root = document.documentElement;
const drawn = [...document.querySelectorAll("svg")].map(one => one.getBoundingClientRect());
const first = document.querySelector(".verdict").getBoundingClientRect();
document.title = JSON.stringify({
  wide: root.scrollWidth, window: root.clientWidth, verdict: first.bottom,
  pictures: drawn.map(one => [one.width, one.height, one.right]),
});
</script>"""

pytestmark = pytest.mark.skipif(not BROWSER, reason="no Chromium is installed")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seen")
    owner = "<script>document.title = 'broken'</script> " + "A very long owner " * 8
    declared = new(0.0, owner, "crossing5", Margin(1.0, 10.0), datetime.date(2026, 1, 31))
    (folder / "profile.toml").write_bytes(declared.source)
    words = ["audit", table(folder), "--profile", str(folder / "profile.toml")]
    words += ["--episodes", "40", "--seed", "1"]
    assert main([*words, "--out", str(folder / "audit")]) in (0, 1, 3)
    return folder / "audit" / "report.html"


def table(folder):
    world = tabulate(make_grid("crossing5"))
    path = folder / ("a_policy_with_a_long_name_" * 4 + ".safetensors")
    save_table(path, TabularPolicy(world.world, expert_policy(world, 0.0)))
    return str(path)


def opened(path, width, *more):
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--window-size={width},900", *more, path.as_uri()]
    return subprocess.run(command, capture_output=True, timeout=120, check=True)


@pytest.mark.parametrize("width", [360, 1280])
def test_nothing_is_cut_off_and_the_verdict_is_on_the_first_screen(page, tmp_path, width):
    copy = tmp_path / "report.html"
    text = re.sub(r"<meta http-equiv[^>]+>", "", page.read_text())
    copy.write_text(text.replace("</body>", f"{PROBE}</body>"))
    drawn = opened(copy, width, "--dump-dom").stdout.decode()
    seen = json.loads(re.search(r"<title>(\{.*?\})</title>", drawn)[1])
    assert seen["window"] == width
    assert seen["wide"] <= width
    assert seen["verdict"] < 700
    assert len(seen["pictures"]) == 3
    for wide, high, right in seen["pictures"]:
        assert wide > 250 and high > 200 and right <= width


def test_the_browser_has_nothing_to_complain_about(page, tmp_path):
    picture = tmp_path / "page.png"
    said = opened(page, 1280, "--enable-logging=stderr", f"--screenshot={picture}").stderr.decode()
    assert "CONSOLE" not in said
    assert picture.stat().st_size > 20_000

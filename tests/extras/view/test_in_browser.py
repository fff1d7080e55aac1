"""Policies and demonstrations in a real browser, by the local server."""

import datetime
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

pytest.importorskip("starlette", reason="extra `web` is not installed")
pytest.importorskip("uvicorn", reason="extra `web` is not installed")
pytest.importorskip("websockets", reason="extra `web` is not installed")

from tests.extras.browsers import PATIENCE, needs_browser, sync_api, watched_tab
from tests.extras.view.made import saved

from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.evaluation.rollout import record
from socialiq.storage import packaged_results
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.world import Intersection

pytestmark = needs_browser


@pytest.fixture(name="tab")
def opened_tab(browser) -> Iterator:
    """A tab that must not complain, nor ask another place for anything."""
    asked: list[str] = []
    with watched_tab(browser, asked) as tab:
        yield tab
    assert {url.split("/")[2].split(":")[0] for url in asked} == {"127.0.0.1"}


def go(tab, address, state=""):
    tab.goto(address + state, wait_until="commit", timeout=PATIENCE)
    ready(tab)


def ready(tab):
    tab.wait_for_selector("html[data-ready], #fault:not([hidden])", state="attached")
    assert tab.inner_text("#fault") == ""


def shown(tab, place):
    return sync_api.expect(tab.locator(place))


def outcome(driver, seed):
    """Return the words of the page for how a driver ends an episode, by the native core."""
    driven = record(Intersection().batch(1), driver, [seed], "one").transitions
    words = {1: "arrives", 2: "collides", 3: "is still waiting"}
    return f"{words[driven.ending[-1]]} after {len(driven.ending)} s"


def test_a_foreign_policy_drives_beside_the_dial_as_it_does_in_python(tab, serving, tmp_path):
    module = tmp_path / "mine.py"
    module.write_text("import numpy as np\ndef go(seen):\n    return np.full(len(seen), 2)\n")
    with serving(f"python:{module}:go", "--allow-code") as address:
        go(tab, address, "#seed=86&step=200")
        said = tab.locator("#stages .said")
        assert said.first.inner_text() == outcome(policies.policy("go"), 86)
        tab.click("#next")
        shown(tab, "#seed").to_have_value("87", timeout=PATIENCE)
        tab.click("#run")
        tab.wait_for_selector("#rates tr")
        assert tab.locator("#rates tr").count() == 2
        assert tab.locator("#curve .curve-mark").count() == 2


def test_a_dial_of_the_users_turns(tab, serving):
    dial = packaged_results() / "intersection-dial-clock" / "timed.safetensors"
    with serving(dial, "--angle", "60") as address:
        go(tab, address, "#chosen=0&seed=86&step=200")
        assert tab.inner_text("#angle") == "60°"
        tab.focus("#dial")
        tab.keyboard.press("Home")
        shown(tab, "#angle").to_have_text("0°", timeout=PATIENCE)
        tab.wait_for_url(lambda url: "own=0" in url, wait_until="commit")
        tab.reload(wait_until="commit")
        ready(tab)
        assert tab.inner_text("#angle") == "0°" and tab.input_value("#seed") == "86"
        assert tab.is_hidden("#fault")  # a reloaded tab is no second one


def test_demonstrations_are_driven_again_or_drawn(tab, serving, tmp_path):
    table = record(
        Intersection().batch(4), policies.policy("idm"), range(86, 90), "idm"
    ).transitions
    files.save(tmp_path / "some.safetensors", table)
    with serving(tmp_path / "some.safetensors") as address:
        go(tab, address, "#step=200")
        words = "Driven again from seed 86 with the recorded decisions: the same observations"
        assert tab.inner_text("#how").startswith(words)
        assert tab.inner_text("#outcome") == outcome(policies.policy("idm"), 86)
        sums = [f"{one[0]:+.2f}".replace("-", "−") for one in table.totals()]
        assert tab.inner_text("#sums") == f"own progress {sums[0]}, effect on others {sums[1]}"
        tab.fill("#episode", "9")
        tab.press("#episode", "Enter")
        assert tab.inner_text("#said") == "An episode is a whole number from 0 to 3."
        tab.click("#before")
        shown(tab, "#episode").to_have_value("3", timeout=PATIENCE)
        for width in (390, 1920):
            tab.set_viewport_size({"width": width, "height": 900})
            assert tab.evaluate("document.documentElement.scrollWidth") <= width


def test_demonstrations_without_seeds_are_drawn_from_what_was_observed(tab, serving, tmp_path):
    table = record(Intersection().batch(2), policies.policy("go"), range(86, 88), "go").transitions
    files.save(tmp_path / "some.safetensors", table.subsample(2))
    with serving(tmp_path / "some.safetensors") as address:
        go(tab, address)
        assert tab.inner_text("#how").startswith("The file gives no seed of this episode")
        assert tab.is_hidden("#bars") and tab.locator("#decisions tr").count() > 2


def test_recorded_traffic_shows_who_yields_to_whom_and_the_rewards(tab, serving, tmp_path):
    pytest.importorskip("shapely", reason="extra `maps` is not installed")
    with serving(saved(tmp_path)) as address:
        go(tab, address)
        assert tab.inner_text("#which") == "32 yields to 31, PET 1.3 s"
        assert tab.locator("#conflicts tr.now td").all_inner_texts() == [
            "31",
            "crossing",
            "1.3 s",
            "0.0",
        ]
        assert tab.inner_text("#outcome") == "0.6 s"  # 4 s before the first enters
        tab.click("#step")
        assert tab.inner_text("#clock") == "1.0 s"
        tab.locator("#drivers button").first.click()
        assert tab.inner_text("#which") == "Vehicle 31"
        tab.focus("#time")
        tab.keyboard.press("End")
        assert tab.inner_text("#clock") == "11.9 s"
        total = tab.locator("#drivers tr").first.locator("td").nth(1).inner_text()
        assert tab.inner_text("#sums").startswith(f"31: own progress {total}, effect on others ")
        tab.click("#far")
        assert tab.inner_text("#which") == "Whole road"
        for width in (390, 1920):
            tab.set_viewport_size({"width": width, "height": 900})
            assert tab.evaluate("document.documentElement.scrollWidth") <= width


def test_an_audit_replays_its_worst_episodes_with_the_rewards_of_the_report(tab, serving, tmp_path):
    declared = declare(0.0, "me", "intersection", Margin(1.0, 10.0), datetime.date(2026, 1, 31))
    (tmp_path / "profile.toml").write_bytes(declared.source)
    words = ["audit", "idm", "--profile", str(tmp_path / "profile.toml"), "--episodes", "20"]
    folder = tmp_path / "audit"
    assert main([*words, "--seed", "5", "--no-log", "--out", str(folder)]) in (1, 3)
    (worst, *_) = json.loads((folder / "report.json").read_text())["episodes"]["worst"]
    with serving(folder) as address:
        go(tab, address, "#step=400")
        assert tab.inner_text("h1") == "Audit of idm"
        assert tab.inner_text("#mode").startswith("worst 1")
        assert worst["seed"] in tab.inner_text("#how")
        assert tab.inner_text("#how").endswith("the rewards of the report, to 1e-9.")
        sums = [f"{worst[name]:+.2f}".replace("-", "−") for name in ("r_env", "r_social")]
        assert tab.inner_text("#sums") == f"own progress {sums[0]}, effect on others {sums[1]}"


def test_a_second_tab_and_a_lost_server_are_said_in_one_line(browser):
    """The server is killed here, as by a crash."""
    command = [sys.executable, "-m", "socialiq", "view", "idm", "--no-open"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=dict(os.environ)) as server:
        try:
            address = server.stderr.readline().decode().strip()
            tabs = [browser.new_page(reduced_motion="reduce") for _ in range(2)]
            go(tabs[0], address)
            tabs[1].goto(address)
            tabs[1].wait_for_selector("#fault:not([hidden])", timeout=PATIENCE)
            assert "Another tab has this policy" in tabs[1].inner_text("#fault")
            assert tabs[0].is_hidden("#fault")
            server.send_signal(signal.SIGKILL)
            tabs[0].wait_for_selector("#fault:not([hidden])", timeout=PATIENCE)
            assert "The server has stopped" in tabs[0].inner_text("#fault")
        finally:
            server.kill()
            for tab in tabs:
                tab.close()


def test_a_policy_that_fails_and_a_browser_without_webassembly_are_said(browser, serving, tmp_path):
    module = tmp_path / "broken.py"
    module.write_text("def broken(seen):\n    raise ValueError('no idea')\n")
    with serving(f"python:{module}:broken", "--allow-code") as address:
        tab = browser.new_page()
        tab.goto(address)
        tab.wait_for_selector("#fault:not([hidden])", timeout=PATIENCE)
        assert "no idea" in tab.inner_text("#fault")
        tab.close()
        tab = browser.new_page()
        tab.add_init_script("delete window.WebAssembly")
        tab.goto(address)
        tab.wait_for_selector("#fault:not([hidden])", timeout=PATIENCE)
        assert "no WebAssembly" in tab.inner_text("#fault")
        tab.close()

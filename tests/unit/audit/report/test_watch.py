"""Replays of a report's episodes: their data, and the policy that allows their program alone."""

import base64
import hashlib
import json
import re

from socialiq.audit.report.views import html, replays
from socialiq.page.webassembly.layout import layout
from socialiq.to_json import to_json
from socialiq.worlds.intersection.options import Options


def at_intersection(report, **options):
    """A report as if of the intersection, with decisions that end no element."""
    report["declaration"]["scenario"] |= {"world": "intersection", "options": options}
    for rows in report["episodes"].values():
        for row in rows:
            row["trace"]["actions"] = "0122"
    return report


def test_in_a_gridworld_there_are_none_and_no_script(plain):
    assert replays(plain) is None
    assert "<script" not in html(plain) and "script-src" not in html(plain)


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
    before = html(plain)
    page = html(at_intersection(plain))
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.S)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}' 'wasm-unsafe-eval'" in page
    assert "connect-src" not in page and "http" not in re.sub("http-equiv|http://www.w3", "", page)
    assert len(page.encode()) - len(before.encode()) < 600_000

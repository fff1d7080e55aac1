"""The report opened by a real browser, at the width of a phone and of a desk."""

import datetime
import re

import pytest
from tests.extras.browsers import needs_browser

from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.cli.main import main
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

MEASURE = """() => {
  const root = document.documentElement;
  const pictures = [...document.querySelectorAll("svg:not(.moving, .span)")];
  const drawn = pictures.map(svg => svg.getBoundingClientRect());
  return {
    wide: root.scrollWidth, window: root.clientWidth,
    verdict: document.querySelector(".verdict > p").getBoundingClientRect().bottom,
    pictures: drawn.map(box => [box.width, box.height, box.right]),
  };
}"""

pytestmark = needs_browser


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seen")
    owner = "<script>document.title = 'broken'</script> " + "A very long owner " * 8
    declared = declare(0.0, owner, "crossing5", Margin(1.0, 10.0), datetime.date(2026, 1, 31))
    (folder / "profile.toml").write_bytes(declared.source)
    words = ["audit", table(folder), "--profile", str(folder / "profile.toml")]
    words += ["--episodes", "40", "--seed", "1"]
    assert main([*words, "--out", str(folder / "audit")]) in (0, 1, 3)
    return folder / "audit" / "report.html"


@pytest.fixture(scope="module")
def at_intersection(tmp_path_factory):
    folder = tmp_path_factory.mktemp("watched")
    declared = declare(45.0, "o", "intersection", Margin(1.0, 10.0), datetime.date(2026, 1, 31))
    (folder / "profile.toml").write_bytes(declared.source)
    words = ["audit", "gap_3s", "--profile", str(folder / "profile.toml")]
    words += ["--episodes", "20", "--seed", "1"]
    assert main([*words, "--out", str(folder / "audit")]) in (0, 1, 3)
    return folder / "audit" / "report.html"


def table(folder):
    world = tabulate(make_grid("crossing5"))
    path = folder / ("a_policy_with_a_long_name_" * 4 + ".safetensors")
    TabularPolicy(world.world, expert_policy(world, 0.0)).save(path)
    return str(path)


@pytest.mark.parametrize("width", [360, 1280])
def test_nothing_is_cut_off_and_the_verdict_is_on_the_first_screen(browser, page, width):
    tab = browser.new_page(viewport={"width": width, "height": 900})
    tab.goto(page.as_uri())
    seen = tab.evaluate(MEASURE)
    tab.close()
    assert seen["window"] == width
    assert seen["wide"] <= width
    assert seen["verdict"] < 700
    assert len(seen["pictures"]) == 3
    for wide, high, right in seen["pictures"]:
        assert wide > 250 and high > 200 and right <= width


STACKED = """() => {
  const cells = [...document.querySelectorAll(".stacked td")];
  return cells.map(cell => {
    const box = cell.getBoundingClientRect();
    return {left: box.left, right: box.right, cut: cell.scrollWidth > cell.clientWidth + 1,
            label: getComputedStyle(cell, "::before").content};
  });
}"""


def test_the_tests_are_read_without_scrolling_sideways_on_a_phone(browser, page):
    tab = browser.new_page(viewport={"width": 390, "height": 800})
    tab.goto(page.as_uri())
    cells = tab.evaluate(STACKED)
    tab.close()
    assert len(cells) == 25
    for cell in cells:
        assert 0 <= cell["left"] < cell["right"] <= 390 and not cell["cut"]
    assert [one["label"] for one in cells[1:5]] == [
        f'"{label}"' for label in ("result", "estimate", "bounds", "asked for")
    ]


PLACES = """() => [...document.querySelectorAll(".moving .ego")].map(one => {
  const box = one.getBoundingClientRect();
  return [box.left, box.top];
})"""


MOVED = f"""before => ({PLACES})().every(
  (place, index) => String(place) !== String(before[index]))"""


def places(tab, after):
    tab.wait_for_timeout(after)
    return tab.evaluate(PLACES)


def test_its_vehicles_move_until_they_are_told_to_stand_still(browser, page):
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.goto(page.as_uri())
    first = places(tab, 100)
    assert len(first) == 6
    tab.wait_for_function(MOVED, arg=first)  # an ego may stand for a while
    tab.check("#pause")
    standing = places(tab, 100)
    assert places(tab, 500) == standing
    tab.close()


@pytest.mark.parametrize("choice", [{"reduced_motion": "reduce"}, {"media": "print"}])
def test_nothing_moves_for_those_who_want_no_motion_and_in_print(browser, page, choice):
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.emulate_media(**choice)
    tab.goto(page.as_uri())
    first = places(tab, 100)
    assert len(first) == 6 and places(tab, 700) == first
    boxes = tab.evaluate(
        "() => [...document.querySelectorAll('.moving')].map(one => one.getBoundingClientRect())"
    )
    for (x, y), box in zip(first, boxes, strict=True):  # the last frame, within the picture
        assert box["left"] <= x <= box["right"] and box["top"] <= y <= box["bottom"]
    tab.close()


PAGE = 688  # CSS pixels: A4 without its margins

CUT = """() => ({
  wide: document.documentElement.scrollWidth,
  breaks: [...document.querySelectorAll("tr, figure, .verdict")].map(
    one => getComputedStyle(one).breakInside),
})"""


def test_pages_on_paper_are_whole(browser, page, tmp_path):
    tab = browser.new_page(viewport={"width": PAGE, "height": 1000})
    tab.emulate_media(media="print")
    tab.goto(page.as_uri())
    found = tab.evaluate(CUT)
    assert found["wide"] <= PAGE
    assert set(found["breaks"]) == {"avoid"}
    printed = tab.pdf(prefer_css_page_size=True)
    tab.close()
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 8


def test_the_browser_has_nothing_to_complain_about(browser, page):
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    said = []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("requestfailed", lambda request: said.append(request.url))
    tab.goto(page.as_uri())
    picture = tab.screenshot(full_page=True)
    tab.close()
    assert said == []
    assert len(picture) > 20_000


def test_a_report_runs_no_script(browser, page, tmp_path):
    """Its content policy stops even a script that was written into the file."""
    broken = tmp_path / "report.html"
    script = "<script>document.title = 'broken'</script></body>"
    broken.write_text(re.sub("</body>", script, page.read_text()))
    tab = browser.new_page()
    with tab.expect_console_message(lambda message: "Content Security Policy" in message.text):
        tab.goto(broken.as_uri())
    assert tab.title() != "broken"
    tab.close()


EACH = """() => [...document.querySelectorAll("#watch .episodes button")].map(button => {
  button.click();
  return document.querySelector("#watch .compared").textContent;
})"""

PIXELS = """() => document.querySelector("#watch canvas").toDataURL()"""


def watched(browser, path, script="", **choice):
    """A tab with the report's player; the browser must not complain, nor ask for anything."""
    tab = browser.new_page(viewport={"width": 1280, "height": 900}, **choice)
    said = []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    if script:
        tab.add_init_script(script)
    tab.goto(path.as_uri())
    tab.wait_for_selector("#watch:not([hidden])")
    return tab, said


def test_episodes_are_replayed_with_the_rewards_of_the_report(browser, at_intersection):
    tab, said = watched(browser, at_intersection)
    found = tab.evaluate(EACH)
    assert len(found) == 6 and all(line.endswith("as in the report, to 1e-9.") for line in found)
    before = tab.evaluate(PIXELS)
    tab.wait_for_function(f"before => ({PIXELS})() !== before", arg=before)  # it plays
    tab.keyboard.press("Tab")
    tab.click("#watch [aria-label='One decision on']")
    assert tab.inner_text("#watch .transport button >> nth=0") == "Play"
    tab.close()
    assert said == []


def test_a_reader_who_wants_no_motion_gets_none(browser, at_intersection):
    tab, said = watched(browser, at_intersection, reduced_motion="reduce")
    tab.click("#watch .episodes button >> nth=2")
    before = tab.evaluate(PIXELS)
    tab.wait_for_timeout(300)
    assert tab.evaluate(PIXELS) == before
    tab.close()
    assert said == []


def test_other_decisions_than_those_of_the_report_are_said(browser, at_intersection, tmp_path):
    text = at_intersection.read_text()
    begin, after = re.split(r'(?<="actions":"\d)(?=\d{3})', text, maxsplit=1)
    changed = begin + ("000" if after.startswith("222") else "222") + after[3:]
    (tmp_path / "report.html").write_text(changed)
    tab, _ = watched(browser, tmp_path / "report.html")
    first, *others = tab.evaluate(EACH)
    tab.close()
    assert "differ from the report's by" in first or "this browser's episode" in first
    assert all(line.endswith("as in the report, to 1e-9.") for line in others)


def test_without_webassembly_the_player_says_so(browser, at_intersection):
    tab, _ = watched(browser, at_intersection, "delete window.WebAssembly")
    assert tab.inner_text("#watch").startswith("[ blank ] The episodes can't be replayed here")
    tab.close()


def test_no_other_script_runs_beside_the_player(browser, at_intersection, tmp_path):
    broken = tmp_path / "report.html"
    script = "<script>document.title = 'broken'</script></body>"
    broken.write_text(re.sub("</body>", script, at_intersection.read_text()))
    tab, said = watched(browser, broken)
    title = tab.title()
    tab.close()
    assert title != "broken"
    assert any("Content Security Policy" in line for line in said)

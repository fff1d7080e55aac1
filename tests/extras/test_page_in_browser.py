"""The page in a real browser: the dial, the clock, links, runs in the background, driving."""

import base64
import re
import urllib.parse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.extras.browsers import PATIENCE, needs_browser, watched_tab

from socialiq.demonstrations import files
from socialiq.page.write import write_page

pytestmark = needs_browser


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    return write_page(tmp_path_factory.mktemp("page")).as_uri()


@pytest.fixture(name="tab")
def opened_tab(browser) -> Iterator:
    """A tab that must not complain, nor ask for anything besides the page itself."""
    asked: list[str] = []
    with watched_tab(browser, asked) as tab:
        yield tab
    assert {url.split(":", 1)[0] for url in asked} <= {"file", "blob"}


def go(tab, address, state=""):
    tab.goto(address + state, wait_until="commit", timeout=PATIENCE)
    tab.wait_for_selector("html[data-ready]", state="attached")


def said_at(tab, place):
    return tab.locator("#stages .said").nth(place).inner_text()


def test_the_dial_turns_by_keys_and_by_mouse_and_drives_again(tab, address):
    go(tab, address, "#seed=12&angles=0,45,85&chosen=1&step=200")
    before = said_at(tab, 1)
    dial = tab.locator("#dial")
    dial.focus()
    for key, angle in (("End", "90"), ("ArrowDown", "89"), ("Home", "0"), ("PageUp", "15")):
        tab.keyboard.press(key)
        assert dial.get_attribute("aria-valuenow") == angle
    tab.keyboard.press("End")
    assert said_at(tab, 1) != before
    assert tab.locator("#stages strong").nth(1).inner_text() == "90°"
    assert said_at(tab, 0) == "arrives after 10 s"
    box = dial.bounding_box()
    tab.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 0.80 * box["height"])
    assert 3 < int(dial.get_attribute("aria-valuenow")) < 15
    assert said_at(tab, 2).startswith("is still waiting")
    tab.mouse.click(box["x"] + 0.21 * box["width"], box["y"] + 0.22 * box["height"])  # C's hand
    assert tab.inner_text("#angle") == "85°"
    tab.locator("#chips button").first.press("Enter")
    assert tab.evaluate("document.activeElement.textContent") == "A 0°"
    tab.keyboard.press("Escape")
    dial.press("ArrowRight")
    assert dial.get_attribute("aria-valuenow") == "1"


@pytest.mark.parametrize(
    ("begin", "end", "angle"), [((0.615, 0.414), (0.319, 0.234), 75), ((0.3, 0.8), (0.3, 0.1), 45)]
)
def test_a_finger_turns_the_dial_by_its_arc_and_scrolls_elsewhere(
    browser, address, begin, end, angle
):
    size = {"width": 390, "height": 844}
    tab = browser.new_page(viewport=size, has_touch=True, is_mobile=True, reduced_motion="reduce")
    go(tab, address, "#tab=fleet&fleet=45")
    box, session = tab.locator("#fleet-dial").bounding_box(), tab.context.new_cdp_session(tab)
    for step in range(11):
        across, down = (x + step / 10 * (y - x) for x, y in zip(begin, end, strict=True))
        place = {"x": box["x"] + across * box["width"], "y": box["y"] + down * box["height"]}
        word = {"type": "touchMove" if step else "touchStart", "touchPoints": [place]}
        session.send("Input.dispatchTouchEvent", word)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    turned = int(tab.get_attribute("#fleet-dial", "aria-valuenow"))
    tab.close()
    assert abs(turned - angle) <= 2


def test_a_link_restores_what_is_shown(tab, address):
    go(tab, address, "#seed=86&angles=0,85&chosen=0&step=63&view=side&tab=turn&speed=2")
    assert tab.input_value("#seed") == "86" and tab.input_value("#speed") == "2"
    assert tab.locator("#stages canvas").count() == 2
    tab.click("#step")
    assert tab.inner_text("#clock") == "7.0 s"
    tab.wait_for_url(lambda url: "step=70" in url, wait_until="commit")
    tab.reload(wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached")
    assert tab.inner_text("#clock") == "7.0 s" and tab.input_value("#seed") == "86"


def test_the_dial_of_what_it_causes_drives_where_that_of_eq_4_2_stands(tab, address):
    go(tab, address, "#seed=12&angles=90&step=300")
    assert said_at(tab, 0).startswith("is still waiting")
    with tab.expect_navigation(wait_until="commit"):
        tab.select_option("#rewarded", label="what it causes")
    tab.wait_for_selector("html[data-ready]", state="attached")
    assert tab.input_value("#rewarded") == "1"
    assert said_at(tab, 0).startswith("arrives after")


def test_a_wrong_link_or_seed_does_no_harm(tab, address):
    go(tab, address, "#seed=-3&angles=0,400&step=x&view=none")
    assert tab.input_value("#seed") == "1" and tab.locator("#stages canvas").count() == 3
    tab.fill("#seed", "a lot")
    tab.press("#seed", "Enter")
    assert tab.inner_text("#said") == "A seed is a whole number from 0 on."
    assert tab.input_value("#seed") == "1"


def test_episodes_in_the_background_give_rates_and_intervals(tab, address):
    go(tab, address, "#angles=0,45&step=1")
    tab.click("#run")
    tab.wait_for_selector("#rates tr")
    share, extent = tab.locator("#rates tr").first.locator("td").first.inner_text().split("\n")
    low, high = map(float, extent.split(" to "))
    assert 85 < low < float(share.removesuffix(" %")) < high < 99
    assert tab.locator("#curve .curve-interval").count() == 2


def test_a_press_counts_for_the_second_under_way_in_its_first_half(tab, address):
    go(tab, address, "#seed=12&tab=drive")
    tab.evaluate("driving.decide()")
    taken = "driving.film.decisions.map(({ action }) => action)"
    for share, words, actions in ((0.4, "now: faster", [2]), (0.6, "in 0.4 s: faster", [1])):
        tab.evaluate(f"driving.decideAgain(1); driving.clock.seek({share} * driving.clock.end)")
        tab.keyboard.press("ArrowUp")
        assert tab.inner_text("#next-decision") == words and tab.evaluate(taken) == actions
        assert tab.get_attribute("#faster", "aria-pressed") == "true"
    tab.evaluate("driving.decide()")
    assert tab.evaluate(taken) == [1, 2]


def test_one_drives_and_downloads_demonstrations(tab, address, tmp_path):
    go(tab, address, "#seed=12&tab=drive")
    tab.evaluate("window.driving.clock.speed = 40")
    tab.click("#start")
    tab.wait_for_selector("#download:not([disabled])")
    assert tab.inner_text("#own").startswith(
        ("You arrive after", "You collide after", "You are still")
    )
    assert tab.inner_text("#own-angle").startswith("4 more")
    with tab.expect_download() as waiting:
        tab.click("#download")
    waiting.value.save_as(tmp_path / "driven.safetensors")
    found = files.load(tmp_path / "driven.safetensors")
    assert found.n_episodes == 1 and found.source["seeds"] == [12]
    ended = tab.inner_text("#own")
    assert tab.inner_text("#beside-said-1").startswith(("arrives", "collides", "is still"))
    tab.reload(wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached")
    assert tab.inner_text("#own-angle").startswith("4 more"), ended
    tab.click("#forget")
    assert tab.inner_text("#own-angle").startswith("5 more")


@pytest.mark.parametrize(("choice", "words"), [("go", "make a car brake"), ("wait", "let 2 cars")])
def test_one_question_is_answered_beside_0_and_45_degrees(tab, address, choice, words):
    tab.set_viewport_size({"width": 1280, "height": 720})
    go(tab, address)
    tab.wait_for_selector("#story-choice.due")
    for name in ("go", "wait"):
        box = tab.locator(f"#story-{name}").bounding_box()
        assert box["y"] + box["height"] < 720
    tab.click(f"#story-{choice}")
    tab.evaluate("story.clock.seek(story.clock.end)")
    assert tab.inner_text("#story-words").startswith(f"You {words}")
    assert "at 45° it lets 2 cars pass and arrives" in tab.inner_text("#story-words")


def test_the_story_has_five_steps_and_ends_with_the_dial(tab, address):
    go(tab, address, "#chapter=1")
    said = []
    for step in range(1, 6):
        assert tab.inner_text("#story-steps") == f"Step {step} of 5"
        tab.evaluate("story.clock.seek(story.clock.end)")
        said.append(tab.locator(".caption").all_inner_texts())
        if step < 5:
            tab.click("#story-on")
    assert said[1] == [
        "arrives after 10 s, makes a car brake hard",
        "arrives after 17 s, lets 2 cars pass",
    ]
    assert said[2] == ["still waits after 20 s", "arrives after 16 s"]
    assert tab.is_hidden("#story-on")
    tab.locator("#story-dial").focus()
    tab.keyboard.press("Home")
    tab.evaluate("story.clock.seek(story.clock.end)")
    assert tab.locator(".caption").nth(1).inner_text() == "arrives after 10 s"


def test_one_of_three_cars_is_as_sold(tab, address):
    go(tab, address, "#tab=sold")
    verdicts = []
    for car in range(3):
        tab.locator("#sold-cars button").nth(car).click()
        tab.wait_for_selector("#sold-verdict:not(:empty)")
        verdicts.append(
            (tab.get_attribute("#sold-verdict", "data-passes"), tab.inner_text("#sold-why"))
        )
    assert sorted(passes for passes, _ in verdicts) == ["false", "false", "true"]
    for passes, why in verdicts:
        assert ("dial at 45°" in why) == (passes == "true")


@pytest.mark.parametrize("width", [390, 1024, 1920])
def test_nothing_is_wider_than_the_window(tab, address, width):
    tab.set_viewport_size({"width": width, "height": 900})
    go(tab, address, "#step=30")
    for name in ("story", "drive", "sold", "turn", "grid", "fleet", "people", "late", "about"):
        tab.click(f"#tab-{name}")
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, name


def test_the_dial_turns_over_the_exact_front(tab, address):
    go(tab, address, "#tab=grid&grid=45")
    assert tab.inner_text("#grid-place").endswith("this lies at 10.0°.")
    assert "from 13.0° to 56.3°" in tab.inner_text("#grid-why")
    before = tab.inner_html("#grid-road")
    tab.locator("#grid-dial").focus()
    tab.keyboard.press("End")
    assert tab.inner_text("#grid-place").endswith("this lies at 152.1°.")
    assert tab.inner_html("#grid-road") != before
    assert "24.0 times" in (tab.get_attribute("#grid-road", "aria-label") or "")
    tab.wait_for_url(lambda url: "grid=90" in url, wait_until="commit")
    tab.reload(wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached")
    assert tab.get_attribute("#grid-dial", "aria-valuenow") == "90"


def test_a_link_shows_an_altruist_that_obstructs_people(tab, address):
    go(tab, address, "#tab=people")
    first, second = tab.locator("#people-stages .caption").all_inner_texts()
    waited = [
        sum(map(float, re.findall(r"\d+\.\d", text.partition(";")[0]))) for text in (first, second)
    ]
    assert waited[0] > 20 > 5 > waited[1]
    assert first.endswith("still waiting after 20 s") and "it arrives" in second
    film = "people.shown[0].film.frames[100].people"
    assert tab.evaluate(f"new Set({film}.map(({{ length }}) => length)).size") == 2


def test_a_link_shows_a_car_that_collides_only_a_second_late(tab, address):
    go(tab, address, "#tab=late")
    captions = tab.locator("#late-stages .caption")
    on_time, late = captions.all_inner_texts()
    assert "arrives" in on_time and "collides" in late
    assert tab.evaluate(UNNAMED) == []
    tab.evaluate("late.clock.seek(35)")
    assert captions.all_inner_texts() == ["brakes", "wants to brake: nothing happens yet"]
    said = " ".join(tab.inner_text("#late-shares").split())
    assert "on time 1 %" in said and "late 36 %" in said and said.endswith("ahead 3 %.")
    tab.check("#late-front")
    assert "arrives" in captions.nth(1).inner_text()
    tab.uncheck("#late-front")
    with tab.expect_navigation(wait_until="commit"):
        tab.click("#late-try")
    tab.wait_for_selector("html[data-ready]", state="attached")
    assert tab.input_value("#latency") == "1" and tab.inner_text("#latency-said") == "1 s"
    tab.evaluate("twins.clock.seek(twins.clock.end)")
    assert said_at(tab, 0).startswith("collides")
    tab.focus("#latency")
    tab.keyboard.press("Home")
    tab.evaluate("twins.clock.seek(twins.clock.end)")
    assert said_at(tab, 0).startswith("arrives")


def test_faults_are_kept_in_the_address_and_reach_the_background(tab, address):
    go(tab, address, "#angles=45&step=1&seed=3")
    shares = []
    for key in ("Home", "End"):
        tab.focus("#latency")
        tab.keyboard.press(key)
        assert tab.locator("#rates tr").count() == 0
        tab.click("#run")
        tab.wait_for_selector("#rates tr")
        shares.append(tab.locator("#rates td").nth(1).inner_text().split("\n")[0])
    assert float(shares[0].removesuffix(" %")) < 5 < 20 < float(shares[1].removesuffix(" %"))
    tab.check("#front")
    tab.wait_for_url(lambda url: "latency=2&unseen=0&noise=0&front=1" in url, wait_until="commit")
    tab.reload(wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached")
    assert tab.is_checked("#front") and tab.input_value("#latency") == "2"


def test_three_fleets_are_counted_as_they_drive(tab, address):
    go(tab, address, "#tab=fleet&fleet=30&trained=1&speed=4")
    assert tab.locator("#fleet-stages strong").all_inner_texts() == [
        "1 of 8 cars at 30°",
        "4 of 8 cars at 30°",
        "all 8 cars at 30°",
    ]
    assert {*tab.locator("#fleet-stages dd").all_inner_texts()} == {"0", "0.0"}
    tab.locator("#fleet-dial").focus()
    tab.keyboard.press("End")
    tab.select_option("#fleet-trained", label="what it causes, among its like")
    tab.evaluate("for (let second = 0; second < 45; second += 1) fleets.advance(); fleets.show()")
    texts = tab.locator("#fleet-stages dd").all_inner_texts()
    assert len(texts) == 12 and all(int(texts[scene]) > 0 for scene in (1, 5, 9))
    assert tab.inner_text("#fleet-seed") != "seed 1"
    assert "if all drive at 90° and not at 0°, fewer get through" in tab.inner_text(
        "#fleet-measured"
    )
    tab.wait_for_url(lambda url: "fleet=90&trained=2" in url, wait_until="commit")
    tab.reload(wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached")
    assert tab.get_attribute("#fleet-dial", "aria-valuenow") == "90"


UNNAMED = """() => [...document.querySelectorAll(
  "button, input, select, [role=slider], [role=img], canvas")].filter(one =>
  !(one.getAttribute("aria-label") || one.labels?.length || one.textContent.trim())
).map(one => one.outerHTML.slice(0, 80))"""


def test_every_control_and_picture_has_a_name_and_tab_reaches_the_dial(tab, address):
    go(tab, address, "#tab=turn&step=30")
    assert tab.evaluate(UNNAMED) == []
    reached = []
    for _ in range(14):
        tab.keyboard.press("Tab")
        reached.append(tab.evaluate("document.activeElement.id"))
    assert "dial" in reached and "play" in reached


def test_without_webassembly_it_says_so(browser, address):
    tab = browser.new_page()
    tab.add_init_script("delete window.WebAssembly")
    tab.goto(address, wait_until="commit", timeout=PATIENCE)
    tab.wait_for_selector("#fault:not([hidden])", timeout=PATIENCE)
    assert "no WebAssembly" in tab.inner_text("#fault")
    tab.close()


def truncated(dial):
    return dial[:-1000]


def not_a_number(dial):
    return dial[:-4] + np.float32("nan").tobytes()


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (truncated, "this is no file of socialiq, or it is damaged: choose another one"),
        (not_a_number, "weights that are no finite numbers: train or choose another one"),
    ],
)
def test_a_dial_that_is_damaged_in_the_page_is_refused_in_one_line(
    browser, address, tmp_path, fault, said
):
    text = open_page(address)
    dial = re.search(r'"dial":"([^"]+)"', text)[1]
    wrong = base64.b64encode(fault(base64.b64decode(dial))).decode()
    message = message_of(browser, tmp_path, text.replace(dial, wrong))
    assert message.endswith(said)


def test_a_page_of_which_the_end_is_missing_names_the_remedy(browser, address, tmp_path):
    text = open_page(address)
    message = message_of(browser, tmp_path, text[: len(text) // 2])
    assert message.endswith("its file is incomplete: fetch or write it again.")


def open_page(address):
    return Path(urllib.parse.urlparse(address).path).read_text()


def message_of(browser, folder, text):
    """The one line that a page shows in place of its parts."""
    (folder / "index.html").write_text(text)
    tab = browser.new_page()
    tab.goto((folder / "index.html").as_uri(), wait_until="load", timeout=PATIENCE)
    (message,) = tab.locator(".fault:visible").all_inner_texts()
    tab.close()
    return message

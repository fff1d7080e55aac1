"""The search of the documentation's site, in a browser: the page on a word comes first."""

import functools
import subprocess
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

pytest.importorskip("furo", reason="extra `docs` is not installed")

from tests.extras.browsers import PATIENCE, needs_browser

ROOT = Path(__file__).parents[2]
FIRST = {
    "quickstart": "start.html",
    "install": "install.html",
    "pedestrian": "worlds/intersection-crosswalk.html",
    "ONNX": "interchange.html",
    "latency": "shifts.html",
    "audit": "audit.html",
    "recording": "first-recording.html",
    "inD": "recordings.html",
    "glossary": "glossary.html",
}

pytestmark = needs_browser


@pytest.fixture(name="site", scope="module")
def address_of_the_site(tmp_path_factory):
    """Serve the site that `make docs` built; build it if there is none."""
    folder = ROOT / "build" / "site"
    if not (folder / "search.html").is_file():
        folder = tmp_path_factory.mktemp("site")
        words = [sys.executable, "-m", "sphinx", "--quiet", str(ROOT / "docs"), str(folder)]
        subprocess.run(words, check=True)
    handler = functools.partial(SimpleHTTPRequestHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_search_finds_the_page_on_a_word_first(browser, site):
    tab = browser.new_page()
    tab.set_default_timeout(PATIENCE)
    first = {}
    for query in FIRST:
        tab.goto(f"{site}/search.html?q={query}")
        tab.wait_for_selector("#search-results .search-summary:has-text('page')")
        first[query] = tab.locator("#search-results ul.search > li > a").first.get_attribute("href")
    assert {query: link.split("?")[0].split("#")[0] for query, link in first.items()} == FIRST

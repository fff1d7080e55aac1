"""A headless Chromium of the system, and tabs whose complaints and requests are kept."""

import contextlib
import shutil
from collections.abc import Iterator

import pytest
from tests.patience import HANG

sync_api = pytest.importorskip("playwright.sync_api", reason="extra `browser` is not installed")

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
BROWSER = next((found for name in NAMES if (found := shutil.which(name))), "")
PATIENCE = 1000 * HANG  # ms

needs_browser = pytest.mark.skipif(not BROWSER, reason="no Chromium is installed")


@contextlib.contextmanager
def launched() -> Iterator:
    """A browser, closed at the end."""
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(
            executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"]
        )
        yield found
        found.close()


@contextlib.contextmanager
def watched_tab(opened, asked: list[str]) -> Iterator:
    """A tab that must not complain; the addresses that it asks for are added to a list."""
    tab = opened.new_page(viewport={"width": 1280, "height": 1000}, reduced_motion="reduce")
    tab.set_default_timeout(PATIENCE)
    said = []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("request", lambda request: asked.append(request.url))
    yield tab
    tab.close()
    assert said == []

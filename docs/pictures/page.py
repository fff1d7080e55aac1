"""Picture of the page: `python docs/pictures/page.py`, with the extra `browser`."""

import shutil
import tempfile
from pathlib import Path

from playwright import sync_api

from socialiq.page.write import write_page

STATE = "#seed=86&angles=0,45,85&chosen=1&step=60"

with tempfile.TemporaryDirectory() as folder, sync_api.sync_playwright() as playwright:
    browser = playwright.chromium.launch(
        executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
    )
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.goto(write_page(Path(folder)).as_uri() + STATE, wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached", timeout=120_000)
    tab.wait_for_timeout(1000)
    tab.screenshot(path=Path(__file__).with_name("page.png"), full_page=True)
    browser.close()

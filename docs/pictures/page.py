"""Still and animated picture of the page: `python docs/pictures/page.py`, with the extra `browser`.

The seed is the one of 1 to 150 in which the first twins differ most, as the page itself finds it.
"""

import io
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright import sync_api

from socialiq.page.write import write_page

HERE = Path(__file__).parent
STATE = "#seed=0&angles=0,45,85&chosen=1&step=1"
CLIP = {"x": 12, "y": 126, "width": 1256, "height": 528}
WIDTH = 1000  # pixels of the animation
FRAME = 125  # ms
HELD = 8  # frames for which the end is held

EVERY = 5  # sub-steps between two frames
TURNED = [*range(45, -1, -5), *range(0, 91, 5), *range(90, 44, -5)]

with tempfile.TemporaryDirectory() as folder, sync_api.sync_playwright() as playwright:
    browser = playwright.chromium.launch(
        executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
    )
    tab = browser.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    tab.set_default_timeout(120_000)
    tab.goto(write_page(Path(folder)).as_uri() + STATE, wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached")
    tab.click("#differ")
    tab.locator("#found button").first.click()
    tab.evaluate("document.getElementById('found').replaceChildren(); twins.say('')")

    def picture(script: str) -> Image.Image:
        """Return the page after a script, as large as the animation."""
        tab.evaluate(script)
        seen = Image.open(io.BytesIO(tab.screenshot(clip=CLIP))).convert("RGB")
        size = (WIDTH, round(WIDTH * seen.height / seen.width))
        return seen.resize(size, Image.Resampling.LANCZOS)

    end = int(tab.evaluate("twins.clock.end"))
    frames = [picture(f"twins.clock.seek({time})") for time in range(0, end + 1, EVERY)]
    frames += HELD * frames[-1:]
    middle = int(0.55 * end)
    frames += [picture(f"twins.turn({angle}); twins.clock.seek({middle})") for angle in TURNED]
    frames += HELD * frames[-1:]
    frames[0].save(
        HERE / "page.webp", save_all=True, append_images=frames[1:], duration=FRAME, loop=0,
        quality=70, method=6, minimize_size=True,
    )  # fmt: skip
    tab.screenshot(path=HERE / "page.png", full_page=True)
    browser.close()

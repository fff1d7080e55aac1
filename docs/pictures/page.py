"""Still and animated picture of the page: `python docs/pictures/page.py`, with the extra `browser`.

They show the page's story: 0 beside 45 degrees, then 90 degrees of both rewards, on its seed.
"""

import io
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright import sync_api

from socialiq.page.write import write_page

HERE = Path(__file__).parent
CHAPTERS = 2, 3
WIDTH = 900  # pixels of the animation
FRAME = 125  # ms
HELD = 16  # frames for which the end of a chapter is held

EVERY = 5  # sub-steps between two frames

with tempfile.TemporaryDirectory() as folder, sync_api.sync_playwright() as playwright:
    browser = playwright.chromium.launch(
        executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
    )
    tab = browser.new_page(viewport={"width": 980, "height": 790}, reduced_motion="reduce")
    tab.set_default_timeout(120_000)
    tab.goto(write_page(Path(folder)).as_uri() + "#chapter=2", wait_until="commit")
    tab.wait_for_selector("html[data-ready]", state="attached")

    tab.evaluate(f"story.go({CHAPTERS[-1]}); window.scrollTo(0, 0)")
    clip = tab.locator("#story .card").bounding_box()

    def picture(script: str) -> Image.Image:
        """Return the page after a script, as large as the animation."""
        tab.evaluate(script)
        seen = Image.open(io.BytesIO(tab.screenshot(clip=clip))).convert("RGB")
        size = (WIDTH, round(WIDTH * seen.height / seen.width))
        return seen.resize(size, Image.Resampling.LANCZOS)

    frames = []
    for chapter in CHAPTERS:
        tab.evaluate(f"story.go({chapter})")
        end = int(tab.evaluate("story.clock.end"))
        frames += [picture(f"story.clock.seek({time})") for time in range(0, end + 1, EVERY)]
        frames += HELD * frames[-1:]
    frames[0].save(
        HERE / "page.webp", save_all=True, append_images=frames[1:], duration=FRAME, loop=0,
        quality=70, method=6, minimize_size=True,
    )  # fmt: skip
    tab.set_viewport_size({"width": 1280, "height": 720})
    tab.evaluate("story.go(2); story.clock.seek(60); window.scrollTo(0, 0)")
    tab.screenshot(path=HERE / "page.png")
    browser.close()

"""The documentation's site embeds the page itself."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def settings():
    return runpy.run_path(str(DOCS / "conf.py"))


def builder(folder, format):
    return SimpleNamespace(builder=SimpleNamespace(format=format), outdir=str(folder))


def test_the_live_page_takes_the_place_of_the_picture(settings, tmp_path):
    text = (DOCS / "page.md").read_text()
    source = [text]
    settings["embed_page"](builder(tmp_path, "html"), "page", source)
    assert '<iframe src="live/index.html"' in source[0] and "pictures/page.png" not in source[0]
    for format, name in (("html", "index"), ("text", "page")):
        untouched = [text]
        settings["embed_page"](builder(tmp_path, format), name, untouched)
        assert untouched == [text]


def test_it_is_written_beside_the_pages_of_a_site_that_was_built(settings, tmp_path):
    settings["write_live_page"](builder(tmp_path, "html"), RuntimeError("it failed"))
    settings["write_live_page"](builder(tmp_path, "text"), None)
    assert not list(tmp_path.iterdir())
    settings["write_live_page"](builder(tmp_path, "html"), None)
    assert (tmp_path / "live" / "index.html").stat().st_size > 500_000

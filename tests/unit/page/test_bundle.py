"""One program of all scripts."""

import re

from socialiq.page.bundle import ASSETS, program


def test_it_holds_every_script_once_and_no_module_syntax():
    text = program()
    for path in ASSETS.glob("*.js"):
        assert text.count(f"const script_{path.stem} = (") == 1, path
    assert not re.search(r"^\s*(import|export)\b", text, re.M)


def test_a_script_comes_after_those_it_imports():
    text = program()
    for one, other in re.findall(r"const \{ [^}]+ \} = (script_\w+);()", text):
        assert text.index(f"const {one} = (") < text.index(f" = {one};") and other == ""


def test_nothing_in_it_ends_its_element():
    assert "</script" not in program() and "<!--" not in program()


def test_scripts_stay_short():
    for path in ASSETS.glob("*.js"):
        assert len(path.read_text().splitlines()) <= 320, path

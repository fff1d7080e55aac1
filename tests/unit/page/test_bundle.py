"""One program of all scripts."""

import re

import pytest

from socialiq.page.write import ASSETS, program

STARTS = ("page", "watch")


def held(start):
    return re.findall(r"^const script_(\w+) = \(", program(start), re.M)


def test_the_programs_hold_every_script():
    assert {name for start in STARTS for name in held(start)} == {
        path.stem for path in ASSETS.glob("*.js")
    }


@pytest.mark.parametrize("start", STARTS)
def test_a_program_holds_a_script_once_and_no_module_syntax(start):
    assert len(held(start)) == len({*held(start)})
    assert not re.search(r"^\s*(import|export)\b", program(start), re.M)


@pytest.mark.parametrize("start", STARTS)
def test_a_script_comes_after_those_it_imports(start):
    text = program(start)
    for one, other in re.findall(r"const \{ [^}]+ \} = (script_\w+);()", text):
        assert text.index(f"const {one} = (") < text.index(f" = {one};") and other == ""


@pytest.mark.parametrize("start", STARTS)
def test_nothing_in_it_ends_its_element(start):
    assert "</script" not in program(start) and "<!--" not in program(start)


def test_scripts_stay_short():
    for path in ASSETS.glob("*.js"):
        assert len(path.read_text().splitlines()) <= 320, path

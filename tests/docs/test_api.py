"""The public names: each has an example in docs/api.md, a purpose, types; importing stays light."""

import inspect
import re
import subprocess
import sys
import typing
from pathlib import Path

import pytest

import socialiq

PAGE = (Path(__file__).parents[2] / "docs" / "api.md").read_text()
SECTIONS = dict(re.findall(r"^### `(\w+)`\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL))


def test_the_page_has_the_public_names_and_no_others():
    assert sorted(SECTIONS) == sorted(socialiq.__all__)
    assert set(socialiq.__all__) <= set(dir(socialiq))


@pytest.mark.parametrize("name", socialiq.__all__)
def test_every_name_has_an_example(name):
    blocks = re.findall(r"^```python\n(.*?)^```", SECTIONS[name], re.MULTILINE | re.DOTALL)
    assert any(f"socialiq.{name}" in block for block in blocks)
    assert not SECTIONS[name].strip().startswith("```")  # words come first


@pytest.mark.parametrize("name", socialiq.__all__)
def test_every_name_has_a_purpose_and_types(name):
    found = getattr(socialiq, name)
    assert len((found.__doc__ or "").split("\n")[0].split()) >= 3
    if inspect.isclass(found):
        return
    found = found.__call__ if inspect.ismodule(found) else found  # `audit` is a package
    parameters = inspect.signature(found).parameters.values()
    assert inspect.signature(found).return_annotation is not inspect.Signature.empty
    assert all(one.annotation is not inspect.Parameter.empty for one in parameters)


def test_type_checkers_see_what_the_interpreter_gets():
    """The imports under TYPE_CHECKING are run here, and held against the lazy ones."""
    text = Path(inspect.getfile(socialiq)).read_text()
    block = re.search(r"^if TYPE_CHECKING:\n((?:    .*\n)+)", text, re.MULTILINE)
    assert block
    seen: dict[str, typing.Any] = {}
    exec(inspect.cleandoc(block[1].replace("\n    ", "\n")), seen)
    del seen["__builtins__"]
    assert sorted(seen) == sorted(socialiq.__all__)
    for name, one in seen.items():
        public = getattr(socialiq, name)
        if inspect.ismodule(public):  # `audit`, whose call is the function's
            assert callable(public)
            continue
        assert (
            getattr(public, "__wrapped__", public) if inspect.isfunction(public) else public
        ) is one


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        socialiq.nothing  # noqa: B018


def test_importing_loads_no_engine():
    """JAX, numba, SciPy and the plots come when a name is used that needs them."""
    code = "import sys, socialiq; print([n for n in ('jax', 'numba', 'scipy', 'matplotlib', "
    code += "'socialiq.cli') if n in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"

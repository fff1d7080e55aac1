"""The notebooks run from their first cell to their last, and show tables and figures."""

import os
import re
import sys
from pathlib import Path

import pytest

nbclient = pytest.importorskip("nbclient", reason="extra `notebooks` is not installed")
nbformat = pytest.importorskip("nbformat", reason="extra `notebooks` is not installed")
FOLDER = Path(__file__).parents[2] / "examples" / "notebooks"


@pytest.mark.parametrize("name", ["steer", "audit", "recorded"])
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the client
def test_a_notebook_runs(name, tmp_path, monkeypatch):
    places = (str(Path(sys.executable).parent), os.environ["PATH"])
    monkeypatch.setenv("PATH", os.pathsep.join(places))  # the command `socialiq` of a cell
    if name == "recorded":
        pytest.importorskip("shapely", reason="extra `maps` is not installed")
    place = tmp_path
    (place / "examples").symlink_to(FOLDER.parent)
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    settings = {"metadata": {"path": str(place)}}
    nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources=settings
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    kinds = {kind for output in outputs for kind in output.get("data", ())}
    assert {"text/html"} <= kinds  # a data frame
    assert ("image/png" in kinds) == (name != "audit")
    said = "".join(output.get("text", "") for output in outputs)
    assert name != "audit" or said.startswith("pass")
    assert not any("Error" in output.get("name", "") for output in outputs)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_uses_public_names_alone(path):
    source = "\n".join(cell.source for cell in nbformat.read(path, as_version=4).cells)
    imported = re.findall(r"^(?:from|import) (\S+)", source, re.MULTILINE)
    assert "socialiq" in imported and not [name for name in imported if name[:9] == "socialiq_"]
    assert not [name for name in imported if name.startswith("socialiq.")]
    import socialiq

    assert {*re.findall(r"\bsocialiq\.(\w+)", source)} <= {*socialiq.__all__}

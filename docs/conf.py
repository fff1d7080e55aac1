"""Sphinx's settings of the documentation's site (`make docs`)."""

import re
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

project = "socialiq"
author = "The socialiq authors"
copyright = author
release = version = installed("socialiq")

extensions = [
    "myst_parser",
    "sphinx.ext.apidoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
html_theme = "furo"
html_search_scorer = str(Path(__file__).with_name("scorer.js"))
html_title = f"socialiq {release}"
copybutton_prompt_text = "$ "

# The API reference: a page for each package, from the docstrings.
apidoc_modules = [
    {
        "path": f"../packages/{name.replace('_', '-')}/src/{name}",
        "destination": f"reference/{name}",
        "exclude_patterns": ["**/__main__.py", "**/cli", "**/guard.py"],
        "module_first": True,
    }
    for name in ("socialiq", "socialiq_recordings", "socialiq_lab")
]
default_role = "code"
autodoc_default_options = {"ignore-module-all": True}
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
# The theme copies every entry of the site's contents into every page: 40 % of the time.
toc_object_entries = False
# Napoleon takes the words before a colon in a property's docstring for a type and looks them up.
suppress_warnings = ["ref.python"]
autodoc_mock_imports = [
    "commonroad",
    "h5py",
    "highway_env",
    "minari",
    "mlflow",
    "onnx",
    "onnxruntime",
    "shapely",
    "stable_baselines3",
    "tensorboard",
    "torch",
    "wandb",
]

# The site has the page itself in the place of its picture.
LIVE = "live"
PICTURE = re.compile(r"^!\[.*\]\(pictures/page\.png\)$", re.M)
FRAME = f"""```{{raw}} html
<iframe src="{LIVE}/index.html" title="Turn the dial"
  style="width: 100%; height: 80vh; border: 0"></iframe>
<p><a href="{LIVE}/index.html">Open it alone</a></p>
```
"""


def embed_page(app: Any, name: str, source: list[str]) -> None:
    """Put the live page in the place of its picture."""
    if name == "page" and app.builder.format == "html":
        source[0] = PICTURE.sub(FRAME, source[0])


def write_live_page(app: Any, error: Exception | None) -> None:
    """Write the page beside the site's pages."""
    if error is None and app.builder.format == "html":
        from socialiq.page.write import page

        folder = Path(app.outdir) / LIVE
        folder.mkdir(exist_ok=True)
        (folder / "index.html").write_text(page(), encoding="utf-8")


def setup(app: Any) -> None:
    """Connect both to the build."""
    app.connect("source-read", embed_page)
    app.connect("build-finished", write_live_page)

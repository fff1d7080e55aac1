"""Sphinx's settings of the documentation's site (`make docs`)."""

from importlib.metadata import version as installed

project = "socialiq"
author = "The socialiq authors"
copyright = author
release = version = installed("socialiq")

extensions = [
    "myst_parser",
    "sphinx.ext.apidoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"socialiq {release}"

# The API reference: a page for each package, from the docstrings.
apidoc_modules = [
    {
        "path": "../src/socialiq",
        "destination": "reference",
        "exclude_patterns": ["**/__main__.py", "**/cli", "**/studies", "**/guard.py"],
        "module_first": True,
    }
]
default_role = "code"
autodoc_default_options = {"ignore-module-all": True}
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
# Napoleon takes the words before a colon in a property's docstring for a type and looks them up.
suppress_warnings = ["ref.python"]
autodoc_mock_imports = [
    "commonroad",
    "h5py",
    "highway_env",
    "minari",
    "onnx",
    "onnxruntime",
    "shapely",
    "stable_baselines3",
    "tensorboard",
    "torch",
]

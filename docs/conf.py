"""Sphinx: the documents of this folder, and the API from docstrings. ``./pioneer docs`` builds it."""

from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = sorted(path.parent / "src" for path in (_ROOT / "catkin_ws" / "src").rglob("setup.py"))

project = "Pioneer fleet"
release = (_ROOT / "VERSION").read_text().strip()
napoleon_use_ivar = True
extensions = ["myst_parser", "autoapi.extension", "sphinx.ext.napoleon"]
html_theme = "alabaster"
html_theme_options = {"page_width": "1100px"}
myst_heading_anchors = 4
suppress_warnings = [
    "myst.header",
    "myst.xref_missing",
    "autoapi.python_import_resolution",
]
autoapi_dirs = [str(path) for path in _PACKAGES]
autoapi_root = "api"
autoapi_keep_files = False
autoapi_options = ["members", "undoc-members", "show-module-summary"]


def setup(app: Sphinx) -> None:
    """Shows diagrams as their text: the script that draws them would have to be loaded from elsewhere."""
    app.add_lexer("mermaid", TextLexer)

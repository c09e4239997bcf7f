"""Sphinx: the documents of this folder, and the API from docstrings. ``./pioneer docs`` builds it."""

import functools
import re
from pathlib import Path
from typing import Any

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
    "autoapi.python_import_resolution",
    "ref.python",  # packages have classes of one name, which annotations name without their package
]
autoapi_dirs = [str(path) for path in _PACKAGES]
autoapi_root = "api"
autoapi_keep_files = False
autoapi_options = ["members", "undoc-members", "show-module-summary"]


def text_of_link(_: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """Returns only the text of a link to a file of the project that is no page here; None if it leads nowhere."""
    file = Path(env.doc2path(node["refdoc"])).parent / node["reftarget"].partition("#")[0]
    return content if file.exists() else None


@functools.cache
def comments_of(module: str) -> dict[tuple[str, str], str]:
    """Returns the ``#:`` comments of a module's fields, by class and field."""
    files = [folder.joinpath(*module.split(".")).with_suffix(".py") for folder in _PACKAGES]
    comments, owner, above = {}, "", ""
    for line in "\n".join(file.read_text() for file in files if file.exists()).splitlines():
        if found := re.match(r"\s*class (\w+)", line):
            owner = found[1]
        if found := re.match(r"\s*#: (.*)", line):
            above += found[1] + "\n"
        else:
            found = re.match(r"\s*(?:self\.)?(\w+)(?:.*  #: (.*))?", line)
            if found and (text := above or found[2]):
                comments[owner, found[1]] = text
            above = ""
    return comments


def describe_field(_: Sphinx, what: str, name: str, item: Any, *__: Any) -> None:
    """Gives a field the comment beside it as its docstring: autoapi reads docstrings alone."""
    if what == "attribute":
        module, owner, field = name.rsplit(".", 2)
        item.docstring = item.docstring or comments_of(module).get((owner, field), "")


def setup(app: Sphinx) -> None:
    """Shows diagrams as their text: the script that draws them would have to be loaded from elsewhere."""
    app.add_lexer("mermaid", TextLexer)
    app.connect("missing-reference", text_of_link)
    app.connect("autoapi-skip-member", describe_field)

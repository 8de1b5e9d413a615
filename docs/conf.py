"""Sphinx configuration of the documentation: `make docs` builds it into build/docs, strictly and without a network."""

from __future__ import annotations

import re
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

from sphinx.util import logging

from layflat.docs import examples, generated

project = "Layflat"
author = "The Layflat authors"
copyright = "The Layflat authors, MIT licence"
version = release = installed_version("layflat")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
source_suffix = {".md": "markdown"}
root_doc = "index"
highlight_language = "none"
default_role = "code"

myst_heading_anchors = 3

autodoc_mock_imports = ["mujoco"]  # an extra
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_inherit_docstrings = False
autodoc_default_options = {"exclude-members": "__init__, __new__, __post_init__"}
python_maximum_signature_line_length = 88
add_module_names = False
toc_object_entries_show_parents = "hide"
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!layflat\.).*"), ("py:class", r"layflat\..*\.T")]
"""Names of other libraries (their pages are not at hand), and type variables."""
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = "Layflat"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "monokai"

LOG = logging.getLogger("layflat.docs")
ATTRIBUTES: dict[str, list[str]] = {}


def make_page(app: Any, name: str, source: list[str]) -> None:
    """Put the generated text in the place of a page, and check its examples."""
    source[0] = re.sub(r"^\|.*\|$", _unbroken, generated.page(name, source[0]), flags=re.M)
    if name not in ("reference/cli", "changelog"):  # a changelog names options that are gone
        for fault in examples.faults(source[0]):
            LOG.warning(fault, location=name)


def _unbroken(row: re.Match[str]) -> str:
    """Keep intervals in the rows of tables on one line."""
    text = re.sub(r"(?<=\d) to (?=[+-]?\d)", "\u00a0to\u00a0", row[0])
    return re.sub(r"(?<=\d) (\[[^\] ]*,) (?=[^\]]*\])", "\u00a0\\1\u00a0", text)


def short_signature(
    app: Any, kind: str, name: str, obj: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Name numpy's array types as the code does."""
    short = [_short(text) if text else text for text in (signature, returns)]
    return short[0], short[1]


def _short(text: str) -> str:
    array = r"[~\w.]*ndarray\[[~\w.]*tuple\[[~\w.]*Any, \.\.\.\], [~\w.]*dtype\[[~\w.]*?(\w+)\]\]"
    text = re.sub(array, r"NDArray[\1]", text).replace("NDArray[float64]", "FloatArray")
    return text.replace("~typing.", "")


def plain_docstring(app: Any, kind: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Take docstrings as plain text with `code`: nothing else in them is markup."""
    lines[:] = [re.sub(r"^(\w+(?:, \w+)*) : (.+)$", r"\1 : ``\2``", _plain(line)) for line in lines]
    if kind in ("attribute", "data", "property"):
        ATTRIBUTES[name] = list(lines)


def keep_attribute(app: Any, kind: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Undo what Napoleon does with an attribute: it takes what stands before a colon for a type."""
    if name in ATTRIBUTES:
        lines[:] = ATTRIBUTES.pop(name)


def _plain(line: str) -> str:
    parts = re.split(r"(``.+?``)", line)
    for n in range(0, len(parts), 2):
        pieces = re.split(r"(`[^`]+`)", parts[n])
        pieces[::2] = [re.sub(r"([*|]|(?<=\w)_(?=\W|$))", r"\\\1", piece) for piece in pieces[::2]]
        parts[n] = "".join(pieces)
    return "".join(parts)


def loads_nothing(app: Any, error: Exception | None) -> None:
    """Check that no built page loads a script, style or picture from a host."""
    for path in Path(app.outdir).rglob("*.html") if error is None else ():
        text = path.read_text(encoding="utf-8")
        for tag in re.findall(r"<(?:script|img|iframe|link)\b[^>]*>", text):
            loaded = re.search(r"\b(?:src|href)=\"((?:https?:)?//[^\"]+)", tag)
            if loaded:
                LOG.warning("%s loads %s", path.name, loaded[1])


def setup(app: Any) -> None:
    """Connect the above."""
    app.connect("source-read", make_page)
    app.connect("autodoc-process-signature", short_signature)
    app.connect("autodoc-process-docstring", plain_docstring, priority=100)
    app.connect("autodoc-process-docstring", keep_attribute, priority=900)
    app.connect("build-finished", loads_nothing)

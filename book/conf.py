"""What Sphinx is told where Jupyter Book is not there: `make sphinx`.

It is the same, from the same ``_config.yml``. Jupyter Book does not read this file, which lies in
the assembled book beside its pages.
"""

from html import escape

from inswsn_book.make.site import footer
from inswsn_book.record.project import Project, find_root
from sphinx.util.inspect import TypeAliasForwardRef

from inswsn_lib.files import read_yaml

# An alias within a type shows its class: https://github.com/sphinx-doc/sphinx/issues/14003
TypeAliasForwardRef.__repr__ = lambda alias: alias.name

_project = Project(find_root())
_asked = read_yaml(_project.root / "_config.yml")
_settings = _asked["sphinx"]["config"]

# what Jupyter Book has another name for
bibtex_bibfiles = _asked["bibtex_bibfiles"]
external_toc_exclude_missing = _asked["only_build_toc_files"]
myst_enable_extensions = _asked["parse"]["myst_enable_extensions"]
nb_execution_mode = _asked["execute"]["execute_notebooks"]
# what it sets by itself
html_sourcelink_suffix = ""
html_theme = "sphinx_book_theme"
# what it hands on, without its own extension and the one that nobody else configures
globals().update(_settings)
extensions = [
    name for name in _settings["extensions"] if name not in ("jupyter_book", "sphinx_comments")
]
# `inswsn_book.make.site`, which writes the foot into pages later, has no part in this
html_theme_options = {**_settings["html_theme_options"], "extra_footer": escape(footer(_project))}

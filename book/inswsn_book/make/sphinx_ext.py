"""The Sphinx extension of the book: every page says whose book it is, and is finished."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from docutils import nodes
from sphinx import addnodes
from sphinx.util import docname_join, logging
from sphinx.util.index_entries import split_index_msg

from inswsn_book.make.access import finish_site
from inswsn_book.make.site import ALONE, FOOTER
from inswsn_book.record.files import text_digest
from inswsn_book.record.project import Project, find_root
from inswsn_book.record.provenance import available_cores

_LOG = logging.getLogger(__name__)
_NAMES = (nodes.title, nodes.caption)


def _configure(app: Any, config: Any) -> None:
    project = Project(find_root())
    about = project.about()
    config.project = config.html_title = about["title"]
    config.author = "; ".join(about["names"])
    config.copyright = about["date-released"][:4]
    config.html_theme_options.setdefault("extra_footer", FOOTER)
    book = Path(app.srcdir)
    if (book / "_sphinx" / "scorer.js").is_file():
        config.html_search_scorer = str(book / "_sphinx" / "scorer.js")
    if (book / "_sphinx" / "404.html").is_file() and not os.environ.get(ALONE):
        config.templates_path = [*config.templates_path, "_sphinx"]
        config.html_additional_pages = {"404": "404.html"}
        lessons = re.findall(r"chapters/[\w-]+", (book / "_toc.yml").read_text(encoding="utf-8"))
        config.html_context["first_lesson"] = next(iter(lessons), "")
    config.mathjax_path = "mathjax/startup.js"  # which loads what mathjax3_config names
    config.html_extra_path += ["moved"] if (book / "moved").is_dir() else []
    host = urlsplit(about["repository-code"] or "").netloc
    if host in ("github.com", "gitlab.com"):  # chapters lie here where they do in the repository
        config.html_theme_options |= {
            "repository_url": about["repository-code"],
            "repository_branch": f"v{about['version']}",
            "path_to_docs": "",
            "launch_buttons": {
                "binderhub_url": "https://mybinder.org",
                "colab_url": "https://colab.research.google.com" if host == "github.com" else "",
                "notebook_interface": "jupyterlab",
            },
        }
    site = project.site
    if os.environ.get(ALONE) and (site / "objects.inv").is_file():
        config.intersphinx_mapping = {"book": (site.as_uri(), str(site / "objects.inv"))}
        config.intersphinx_disabled_reftypes = []


class _Kept:
    """An environment that loads the tree of a page once."""

    def __init__(self, env: Any) -> None:
        self._env, self.get_doctree = env, cache(env.get_doctree)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)


def _keep_outline(app: Any, tree: nodes.document) -> None:
    """Keep what numbers the figures of a page: to load and search all pages takes seconds."""
    known = [domain.enumerable_nodes for domain in app.env.domains.values()]
    others = (nodes.section, nodes.literal_block, addnodes.toctree, *_NAMES)
    numbered = (*others, *chain.from_iterable(known))
    outlines = app.env.inswsn_outlines = getattr(app.env, "inswsn_outlines", {})
    outlines[app.env.docname] = nodes.Element("", *_outlines(tree, numbered))


def _keep_entries(app: Any, tree: nodes.document) -> None:
    """Keep what a search finds by the index: Sphinx keeps it of the pages that it writes alone."""
    entries = set[tuple[str, str, str]]()
    for node in tree.findall(addnodes.index):
        for kind, value, target, main, _ in node["entries"]:
            entries |= {(word, target or "", main) for word in split_index_msg(kind, value)}
    kept = getattr(app.env, "_search_index_index_entries", {})
    kept[app.env.docname] = sorted(entries)


def _outlines(node: nodes.Element, numbered: tuple[type, ...]) -> Iterator[nodes.Element]:
    """Return copies of the branches of a tree in which something is numbered, without the others.

    Only what has a title or a caption has a number.
    """
    for child in filter(lambda child: isinstance(child, nodes.Element), node.children):
        inner = [*_outlines(child, numbered)]
        if inner or isinstance(child, numbered):
            copy = child.copy()
            copy.document, copy.rawsource = None, ""  # they would be kept
            copy.extend([nodes.Text(child.astext())] if isinstance(child, _NAMES) else inner)
            yield copy


def _unlink_words(app: Any, tree: nodes.document) -> None:
    """Leave the words of a shape, ``(steps, runs)``, words: our types begin with a capital.

    Sphinx 9 takes each for a type, and finds any attribute of that name.
    """
    for link in [*tree.findall(addnodes.pending_xref)]:
        if link["reftype"] == "class" and re.fullmatch("[a-z_]+", link["reftarget"]):
            link.replace_self(link.children)


def _number_outlines(app: Any, env: Any) -> list[str]:
    env.toc_fignumbers = getattr(env, "inswsn_counted", {})  # what Sphinx counted last time
    env.get_doctree = lambda name: env.inswsn_outlines[name]
    return []


def _before_writing(app: Any, env: Any) -> None:
    """Let pages be written side by side, and each numbered reference not load a whole page.

    To read pages side by side is not safe with sphinx_proof.
    """
    app.parallel = available_cores()
    domain, kept = env.get_domain("std"), _Kept(env)
    resolve = domain._resolve_numref_xref
    domain._resolve_numref_xref = lambda _, *words: resolve(kept, *words)


def _whole_name(app: Any, env: Any, node: Any, words: Any) -> None:
    """Give a page that is looked for in the built book its name from the root of the book."""
    if node.get("reftype") == "doc":
        node["reftarget"] = docname_join(node["refdoc"], node["reftarget"])


def _of_page(kinds: dict[str, dict[str, Any]]) -> dict[str, dict[str, tuple[int]]]:
    """Return the numbers of figures, tables and the like of a page, counted within the page."""
    return {
        kind: {name: (place,) for place, name in enumerate(names, 1)}
        for kind, names in kinds.items()
    }


def _update(app: Any, env: Any) -> list[str]:
    """Return the pages to be written: all of them, once what they may name of others differs."""
    del env.get_doctree  # once all is numbered
    env.inswsn_counted = env.toc_fignumbers
    env.toc_fignumbers = {page: _of_page(kinds) for page, kinds in env.toc_fignumbers.items()}
    domain, titles = env.get_domain("std"), {k: v.astext() for k, v in env.titles.items()}
    named = [domain.labels, domain.anonlabels, env.get_domain("math").equations, titles]
    named += [env.toc_secnumbers, env.toc_fignumbers]
    objects = [sorted(domain.get_objects()) for _, domain in sorted(env.domains.items())]
    # what is read anew moves to the end of a dict
    digest = text_digest(repr([*(sorted(names.items()) for names in named), objects]))
    changed, env.inswsn_named = getattr(env, "inswsn_named", digest) != digest, digest
    return sorted(env.found_docs) if changed else []


def _colour_symbols(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Mark the symbols that a page names, in its code and for its equations: a colour each."""
    symbols = str((context.get("meta") or {}).get("symbols", "")).split()
    for symbol in symbols:
        plain = f'<span class="n">{symbol}</span>'
        marked = f'<span class="n symbol-{symbol}">{symbol}</span>'
        context["body"] = context["body"].replace(plain, marked)
    if symbols:
        marks = f'<section data-symbols="{" ".join(symbols)}"'
        context["body"] = context["body"].replace("<section", marks, 1)


def _finish(app: Any, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        for problem in finish_site(Path(app.outdir), Path(app.doctreedir, "finished.json")):
            _LOG.warning("%s", problem)


def _skip(app: Any, what: str, name: str, member: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what a class does not say of itself: fields of tuples, routing of metadata."""
    generated = type(member).__name__ == "_tuplegetter" or re.fullmatch("set_.*_request", name)
    return True if generated else None


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    if os.environ.get(ALONE):
        app.setup_extension("sphinx.ext.intersphinx")
        app.connect("missing-reference", _whole_name, priority=100)
    # before the handlers that work on what is set here
    app.connect("config-inited", _configure, priority=100)
    app.connect("env-check-consistency", _before_writing)
    app.connect("doctree-read", _unlink_words)
    app.connect("doctree-read", _keep_outline, priority=900)
    app.connect("doctree-read", _keep_entries, priority=900)
    app.connect("env-get-updated", _number_outlines, priority=100)
    app.connect("env-get-updated", _update, priority=900)
    app.connect("autodoc-skip-member", _skip)
    app.connect("html-page-context", _colour_symbols)
    app.connect("build-finished", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

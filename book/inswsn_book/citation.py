"""How the artefact is cited: every form of it is made from ``data/about.yaml``."""

from __future__ import annotations

import codecs
import json
import textwrap
from html import escape
from typing import Any

import latexcodec  # noqa: F401  # the codec ulatex
import yaml

from inswsn_book.about import About, Author, load_about
from inswsn_book.files import write_whole
from inswsn_book.project import Project
from inswsn_book.references import Article, read_articles
from inswsn_book.third_party import load_third_party, third_party_text
from inswsn_book.verdicts import Judged
from inswsn_lib.errors import InswsnError

_MADE = "Made from data/about.yaml by `make citation`; edit that file."
_KIND = "Jupyter Book and Python library"


def citation_files(project: Project) -> dict[str, str]:
    """Return what is made from ``data/about.yaml`` and kept, by its place in the checkout.

    Raises
    ------
    InswsnError
        If a source cannot be read.
    """
    about = load_about(project.root)
    articles = read_articles(project.root, about)
    return {
        "CITATION.cff": cff_text(about, articles),
        ".zenodo.json": zenodo_text(about, articles),
        "THIRD-PARTY.md": third_party_text(load_third_party(project.root), articles),
    }


def differing_citations(project: Project) -> list[str]:
    """Return the kept files that differ from what they are made from, or are missing."""
    return [
        name
        for name, text in citation_files(project).items()
        if not (path := project.root / name).is_file() or path.read_bytes() != text.encode()
    ]


def require_citations(project: Project) -> None:
    """Raise `InswsnError` if a kept file differs from what it is made from."""
    differing = differing_citations(project)
    if differing:
        one = len(differing) == 1
        raise InswsnError(
            f"{' and '.join(differing)} {'differs' if one else 'differ'} from what "
            f"data/about.yaml says; write {'it' if one else 'them'} again: make citation."
        )


def write_citations(project: Project) -> list[str]:
    """Write the files that differ; return their names.

    Raises
    ------
    InswsnError
        If a source cannot be read; then nothing is written.
    OSError
        If the checkout cannot be written.
    """
    texts = citation_files(project)
    differing = differing_citations(project)
    for name in differing:
        write_whole(project.root / name, texts[name])
    return differing


def cff_text(about: About, articles: list[Article]) -> str:
    """Return CITATION.cff, of version 1.2.0 of the Citation File Format.

    The format takes several licences for a choice between them. So it names that of the code; the
    message names that of the text.

    Parameters
    ----------
    about : About
    articles : list of Article
        The papers that it rebuilds: its references.
    """
    content: dict[str, Any] = {
        "cff-version": "1.2.0",
        "type": "software",
        "title": about.title,
        "message": (
            "Cite the version that you used; for one verdict, add the id of the claim, as the "
            f"page 'How to cite' shows. Text and figures are under {about.licences.text}."
        ),
        "abstract": about.abstract,
        "authors": [_cff_author(author) for author in about.authors],
        "keywords": list(about.keywords),
        "license": about.licences.code,
        "version": about.version,
        "date-released": about.released,
    }
    if about.repository is not None:
        content["repository-code"] = about.repository
    if about.doi is not None:
        archived = {"type": "doi", "value": about.doi, "description": "The archived release."}
        content |= {"doi": about.doi, "identifiers": [archived]}
    if articles:
        content["references"] = [_cff_reference(article) for article in articles]
    text: str = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)
    return f"# {_MADE}\n{text}"


def _cff_author(author: Author) -> dict[str, str]:
    fields = {
        "name": author.name,
        "family-names": author.family,
        "given-names": author.given,
        "orcid": author.orcid,
        "affiliation": author.affiliation,
    }
    return {name: value for name, value in fields.items() if value is not None}


def _cff_reference(article: Article) -> dict[str, Any]:
    fields = {
        "type": "article",
        "title": article.title,
        "authors": [
            {"family-names": family, "given-names": given} for family, given in article.authors
        ],
        "journal": article.journal,
        "year": article.year,
        "volume": article.volume,
        "issue": article.number,
        "start": article.pages[0] if article.pages else None,
        "end": article.pages[1] if len(article.pages) > 1 else None,
        "doi": article.doi,
        "notes": f"The paper that the book calls {article.name}.",
    }
    return {name: value for name, value in fields.items() if value is not None}


def zenodo_text(about: About, articles: list[Article]) -> str:
    """Return .zenodo.json, in the form of Zenodo's deposit metadata.

    The papers are cited. The artefact is no supplement of theirs, since their authors have no part
    in it. A DOI is not given: Zenodo gives each version one.

    Parameters
    ----------
    about : About
    articles : list of Article
        The papers that it rebuilds.
    """
    content = {
        "title": about.title,
        "description": f"<p>{escape(about.abstract, quote=False)}</p>",
        "upload_type": "software",
        "access_right": "open",
        "creators": [_zenodo_creator(author) for author in about.authors],
        "keywords": list(about.keywords),
        # Zenodo's own list of licences has the SPDX names in small letters, and takes one
        "license": about.licences.code.lower(),
        "notes": _licences_sentence(about),
        "version": about.version,
        "publication_date": about.released,
        "language": "eng",
        "related_identifiers": [
            {
                "identifier": article.doi,
                "relation": "cites",
                "resource_type": "publication-article",
                "scheme": "doi",
            }
            for article in articles
        ],
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _zenodo_creator(author: Author) -> dict[str, str]:
    # the form knows persons only: a group stands under its name
    creator = {"name": author.listed}
    if author.affiliation is not None:
        creator["affiliation"] = author.affiliation
    if author.orcid is not None:
        creator["orcid"] = author.orcid.rpartition("/")[2]
    return creator


def _licences_sentence(about: About) -> str:
    return (
        f"The code is under {about.licences.code} (LICENSE), text and figures are under "
        f"{about.licences.text} (LICENSE-TEXT), and THIRD-PARTY.md names what belongs to others."
    )


def bibtex_text(about: About, *, key: str = "inswsn", note: str = "") -> str:
    """Return the entry for a BibTeX file.

    Parameters
    ----------
    about : About
    key : str
        The key of the entry.
    note : str
        What stands in the note after the version, for example one claim.
    """
    fields = {
        "author": " and ".join(_bibtex_author(author) for author in about.authors),
        "title": f"{{{_latex(about.title)}}}",
        "year": about.year,
        "howpublished": _KIND,
        "note": _latex(f"Version {about.version}{note}"),
        # these two are taken literally
        "doi": about.doi,
        "url": _address(about),
    }
    lines = [f"  {name:<12} = {{{value}}}" for name, value in fields.items() if value]
    return f"@misc{{{key},\n" + ",\n".join(lines) + "\n}\n"


def _bibtex_author(author: Author) -> str:
    # in braces a name stays as it is, whatever commas and "and" are in it
    if author.name is not None:
        return f"{{{_latex(author.name)}}}"
    return f"{{{_latex(author.family or '')}}}, {{{_latex(author.given or '')}}}"


def _latex(text: str) -> str:
    """Return a text with the signs escaped that LaTeX takes for commands."""
    escaped: str = codecs.encode(text, "ulatex+utf-8")  # type: ignore[assignment]  # it is a str
    return escaped


def _address(about: About) -> str:
    return f"https://doi.org/{about.doi}" if about.doi is not None else about.repository or ""


def plain_text(about: About, part: str = "") -> str:
    """Return a citation as one line of plain text.

    Parameters
    ----------
    about : About
    part : str
        What of it is cited, for example one chapter.
    """
    names = "; ".join(author.listed for author in about.authors)
    line = f"{names} ({about.year}). {about.title}. Version {about.version}. {_KIND}."
    line += f" {part}." if part else ""
    address = _address(about)
    return f"{line} {address}" if address else line


def citation_page(about: About) -> str:
    """Return the citation of the whole as MyST Markdown: plain text, and BibTeX."""
    return _lines(plain_text(about)) + "\n" + _block("bibtex", bibtex_text(about))


def verdict_page(about: About, judged: list[Judged]) -> str:
    """Return one verdict, cited as an example, as MyST Markdown.

    The example is the first claim of the ledger that a chapter decides.

    Parameters
    ----------
    about : About
    judged : list of Judged
        The claims with their verdicts.
    """
    example = next((entry for entry in judged if entry.quantity is not None), None)
    if example is None:
        return "No chapter decides a claim yet.\n"
    claim = example.claim
    place = f"claims.html#{claim.anchor}"
    said = f"claim {claim.id}: {example.verdict}"
    return "\n".join(
        [
            f"The claim [{claim.id}](#{claim.anchor}) stands in {claim.place} of {claim.paper}:",
            f"{claim.says} Its verdict in version {about.version} is *{example.verdict}*.",
            "",
            _lines(plain_text(about, f"{said[:1].upper()}{said[1:]}, {place}")),
            _block(
                "bibtex",
                bibtex_text(about, key=f"inswsn-{claim.id}", note=f", {said}, {place}"),
            ),
        ]
    )


def _lines(text: str) -> str:
    # as wide as the page shows it without scrolling
    wrapped = textwrap.wrap(text, 72, break_long_words=False, break_on_hyphens=False)
    return _block("text", "\n".join(wrapped))


def _block(language: str, text: str) -> str:
    return f"`````{{code-block}} {language}\n{text.rstrip()}\n`````\n"

"""Chapters as notebooks that read anywhere: plain Markdown, with numbers and words in the prose.

So are the twins in git, the downloads of the site, and what ``inswsn run`` writes. The build itself
executes and renders the MyST sources.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from inswsn_book.record.files import write_whole
from inswsn_book.record.notebooks import notebook_text, read_source
from inswsn_book.record.project import Chapter, Project, find_root
from inswsn_book.record.results import Results
from inswsn_book.run.store import reference_results
from inswsn_lib.files import read_text

_ROLE = re.compile(r"\{([\w:-]+)\}`([^`]+)`")
_BOLD = re.compile(r"\*\*[^*]+\*\*")
_FENCE = re.compile(r"(`{3,}|:{3,}|~{3,})(?:\{([\w:-]+)\} *(.*))?")
_OPTION = re.compile(r":([\w-]+):(?: +(.*))?")
#: Labels, empty tags, and links within the book, which lead nowhere in a notebook
_NOWHERE = re.compile(r"^\([^()\s]+\)=\n|<(span|section)\b[^>]*></\1>|\[([^]]*)\]\(#[^)]*\)", re.M)
_LABELLED = re.compile(r"^[`:~]{3,}\{([\w:-]+)\}.*\n(?::.*\n)*?:(?:label|name): (\S+)", re.M)
_LABEL = re.compile(r"^\(([^()\s]+)\)=\n(?=(?:\(.*\)=\n)*#+ +(.*))", re.M)
_NUMBERED = {"list-table": "Table", "figure": "Fig.", "exercise-start": "Exercise", "math": ""}
_SHOWN = re.compile(r"""name=["']((?:fig|tbl)-[\w-]+)["']""")
_PYTHON = ("class", "func", "meth", "mod")
_SILENT = ("exercise-end", "index", "raw", "solution-end")


class PlainBook:
    """The chapters of a project in plain Markdown: where labels lead, and what is cited."""

    def __init__(self, project: Project) -> None:
        self._project, about = project, project.about()
        self._bibliography = project.root / "book" / "references.bib"
        address = about["repository-code"]
        checkout = f"[inswsn]({address})" if address else "inswsn"
        self._install = (
            f"To run this notebook, run `make environment` in a checkout of {checkout}, and use "
            "the Python of its `.venv`; `inswsn_lib` alone is not enough."
        )
        self._titles: dict[str, str] = {}  # of pages and labels
        self._homes: dict[str, str] = {}  # the pages of labels
        self._numbers: dict[str, dict[str, str]] = {}  # what labels are called, by chapter
        self._chapters = {f"chapters/{chapter.name}": chapter for chapter in project.chapters()}
        self._cited: Mapping[str, Any] = {}
        pages = {path.stem: path for path in (project.root / "book").glob("*.md")}
        pages |= {page: chapter.source for page, chapter in self._chapters.items()}
        for page, path in pages.items():
            text = read_text(path)
            self._titles["/" + page] = next(iter(re.findall(r"^# +(.*)", text, re.M)), page)
            labels = dict(_LABEL.findall(text))
            self._titles |= labels
            named = [*_SHOWN.findall(text), *(label for _, label in _LABELLED.findall(text))]
            self._homes |= dict.fromkeys([*labels, *named], page)

    def notebook(
        self, chapter: Chapter, notebook: Any, results: Results, folder: Path | None = None,
        *, published: bool = False,
    ) -> Any:  # fmt: skip
        """Put a chapter's notebook into plain Markdown, in place, and return it.

        Its numbers are those of the results; a notebook without outputs has the published ones, and
        captions for figures that it does not show. Links lead to the notebooks in ``chapters/``,
        from the chapter's own folder or from another one.
        """
        import nbformat  # noqa: PLC0415  # takes half a second

        numbers = _numbers(notebook, results.words)
        prose = _Prose(self, chapter, results, numbers, folder or chapter.source.parent)
        cells = []
        for cell in notebook.cells:
            if cell.cell_type == "markdown":
                cell.source = prose.text(cell.source)
            else:
                cell.outputs = list(prose.outputs(cell.outputs))
            cells += [cell] if cell.source else []
            if published and cell.cell_type == "code":
                for label in _shown(cell, results.words):
                    about = {"id": f"{cell['id']}-{label}"[:64]}
                    cells.append(nbformat.v4.new_markdown_cell(prose.caption(label), **about))
        word = chapter.id.removeprefix("lesson-")
        said = "this run."
        if published:
            said = f"the published run; `inswsn run {word}` writes a notebook with its own."
        note = f"> {self._install} Numbers in the text are those of {said}"
        if chapter.lesson:
            note += " Figures are static here; in the book and with `make lab` they move."
        title, _, rest = cells[0].source.partition("\n")
        cells[0].source = f"{title}\n\n{note}\n{rest}".rstrip()
        notebook.cells = cells
        return notebook

    def title(self, place: str) -> str:
        """Return the title of a page, whose name begins with a slash, or of a label."""
        return self._titles.get(place, place.strip("/"))

    def twin(self, page: str | None) -> Path | None:
        """Return the notebook of a page, or None if it is no chapter."""
        return self._chapters[page].twin if page in self._chapters else None

    def home(self, label: str) -> str | None:
        """Return the page on which a label is."""
        return self._homes.get(label)

    def number(self, label: str) -> str:
        """Return what a figure, a table or the like of any chapter is called on its page."""
        if (page := self._homes.get(label, "")) in self._chapters and page not in self._numbers:
            chapter = self._chapters[page]
            words = reference_results(self._project, chapter.id).words
            self._numbers[page] = _numbers(read_source(chapter), words)
        return self._numbers.get(page, {}).get(label, label)

    def citation(self, key: str) -> tuple[str, str]:
        """Return the authors of a cited work, and its year."""
        if not self._cited:
            from pybtex.database import parse_file  # noqa: PLC0415  # takes long

            self._cited = parse_file(str(self._bibliography)).entries
        entry = self._cited[key]
        names = [" ".join(p.prelast_names + p.last_names) for p in entry.persons.get("author", [])]
        names = names or [entry.fields["organization"]]
        who = f"{names[0]} et al." if len(names) > 2 else " and ".join(names)
        return who, entry.fields["year"]


class _Prose:
    """The prose of one notebook."""

    def __init__(
        self, book: PlainBook, chapter: Chapter, results: Results, numbers: Mapping[str, str],
        folder: Path,
    ) -> None:  # fmt: skip
        self._book, self._page, self._folder = book, f"chapters/{chapter.name}", folder
        self._numbers = numbers
        found = {q.name: int(v) if (v := q.value).is_integer() else v for q in results.quantities}
        self._words: dict[str, Any] = {**found, **results.words}

    def text(self, source: str) -> str:
        """Return a piece of MyST Markdown as plain Markdown."""
        return "\n\n".join(filter(None, self._pieces(source.split("\n"))))

    def caption(self, label: str, words: str = "") -> str:
        """Return the caption of a figure or table, with its number."""
        words = words or self._line(self._words.get(label, ""))
        return f"**{number}.** {words}" if (number := self._numbers.get(label)) else words

    def outputs(self, outputs: Sequence[Any]) -> Iterator[Any]:
        """Yield the outputs that say something outside the book."""
        for output in outputs:
            data, about = output.get("data", {}), output.get("metadata", {})
            if "scrapbook" in about or 'class="moving"' in "".join(data.get("text/html", "")):
                continue
            if "table" in about:
                data["text/markdown"] = self.text("".join(data["text/markdown"]))
                del data["text/html"]  # it would be shown instead, without formulas
            yield output
            if "inswsn" in about:
                said = {"text/markdown": self.caption(about["inswsn"]["name"])}
                yield type(output)(output | {"data": said, "metadata": {}})

    def _pieces(self, lines: list[str]) -> Iterator[str]:
        prose: list[str] = []
        while lines:
            line, *lines = lines
            fence = _FENCE.match(line)
            if fence is None:
                prose.append(line)
                continue
            yield self._line("\n".join(prose))
            mark, prose = fence[1], []
            ends = (i for i, end in enumerate(lines) if end.strip(mark[0] + " ") == ""
                    and end.strip().startswith(mark))  # fmt: skip
            end = next(ends, len(lines))
            body, lines = lines[:end], lines[end + 1 :]
            if fence[2]:
                yield self._directive(fence[2], fence[3], body)
            else:
                yield "\n".join([line, *body, mark])
        yield self._line("\n".join(prose))

    def _directive(self, kind: str, title: str, body: list[str]) -> str:
        options: dict[str, str] = {}
        while body and (option := _OPTION.fullmatch(body[0])):
            options[option[1]] = option[2] or ""
            body = body[1:]
        label = options.get("label", options.get("name", ""))
        number, title = self._numbers.get(label, ""), self._line(title)
        inner = self.text("\n".join(body)) if kind not in ("list-table", "math") else ""
        word = number or kind.removeprefix("prf:").capitalize()
        parts = [f"**{word}{title and f' ({title})'}.**", inner]  # a theorem or the like
        if kind in _SILENT:
            parts = []
        elif kind == "math":
            tag = f"\\tag{{{number}}}\n" if number else ""
            parts = ["$$\n" + "\n".join(body).strip() + f"\n{tag}$$"]
        elif kind == "exercise-start":
            parts = [f"**{number or 'Exercise'}: {title}**", inner]
        elif kind == "solution-start":
            parts = ["**Solution.**", inner]
        elif kind == "list-table":
            parts = [self.caption(label, title), self._table(options, body)]
        elif kind in ("figure", "image"):
            parts = [f"![{options.get('alt', '')}]({title})", self.caption(label, inner)]
        elif kind == "div":
            parts = [inner]
        elif not kind.startswith("prf:"):
            if kind not in ("admonition", "dropdown"):
                inner, title = f"{title}\n\n{inner}".strip(), word
            lines = f"**{title}**\n\n{inner}".split("\n")
            parts = ["\n".join(f"> {line}".rstrip() for line in lines)]
        return "\n\n".join(filter(None, parts))

    def _table(self, options: Mapping[str, str], body: list[str]) -> str:
        rows = re.split(r"^\* -", "\n".join(body).strip(), flags=re.M)[1:]
        cells = [[self._cell(cell) for cell in re.split(r"^  -", r, flags=re.M)] for r in rows]
        if "header-rows" not in options:
            cells.insert(0, [""] * len(cells[0]))
        lines = [cells[0], ["---"] * len(cells[0]), *cells[1:]]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)

    def _cell(self, source: str) -> str:
        """Return a cell of a table; a bar would end it, so that a formula has a name for it."""
        bars = {r"\|": r"\Vert ", "|": r"\vert "}

        def formula(match: re.Match[str]) -> str:
            return re.sub(r"\\?\|", lambda bar: bars[bar[0]], match[0])

        text = re.sub(r"\$[^$]+\$", formula, self._line(" ".join(source.split())))
        return re.sub(r"(?<!\\)\|", r"\|", text)

    def _line(self, prose: str) -> str:
        """Return prose without directives."""
        prose = _NOWHERE.sub(lambda found: found[2] or "", prose)
        prose = re.sub(r"^(\S.*)\n: +", r"- \1: ", prose, flags=re.M)  # a definition
        prose = _BOLD.sub(lambda bold: _ROLE.sub(lambda r: self._role(r, ""), bold[0]), prose)
        prose = _ROLE.sub(lambda role: self._role(role, "**"), prose)
        return re.sub(r"\n{3,}", "\n\n", prose).strip("\n")

    def _role(self, match: re.Match[str], strong: str) -> str:
        role, text = match[1], " ".join(match[2].split())
        words, _, target = (p.strip() for p in text.removesuffix(">").rpartition("<"))
        shown = words or target
        if role == "glue:text":
            name, _, form = text.partition(":")
            value = self._words.get(name, "…")
            number = not isinstance(value, str)
            shown = f"{strong}{format(value, form.replace('d', '.0f') if number else '')}{strong}"
        elif role in _PYTHON:
            shown = f"`{shown.lstrip('~')}`"
        elif role.startswith("cite"):
            cited = [self._book.citation(key.strip()) for key in target.split(",")]
            shown = " and ".join(f"{who} ({year})" for who, year in cited)
            if role != "cite:t":
                shown = f"({'; '.join(f'{who}, {year}' for who, year in cited)})"
        elif role in ("numref", "prf:ref", "eq"):
            shown = words or self._numbers.get(target) or self._book.number(target)
            shown = self._link(f"({shown})" if role == "eq" else shown, self._book.home(target))
        elif role in ("doc", "download"):
            place = posixpath.join("/", posixpath.dirname(self._page), target)
            place = posixpath.normpath(place).removesuffix(".ipynb")
            shown = self._link(words or self._book.title(place), place.lstrip("/"))
        elif role == "ref":
            shown = self._link(words or self._book.title(target), self._book.home(target))
        return shown

    def _link(self, words: str, page: str | None) -> str:
        """Return words as a link to another chapter; of other pages there is no notebook."""
        twin = self._book.twin(page)
        if twin is None or page == self._page:
            return words
        return f"[{words}]({Path(os.path.relpath(twin, self._folder)).as_posix()})"


def _shown(cell: Any, words: Mapping[str, str]) -> list[str]:
    """Return the labels of figures and tables that a code cell names, or has shown."""
    about = [output.get("metadata", {}) for output in cell.outputs]
    shown = [(a.get("inswsn") or a.get("table") or {}).get("name") for a in about]
    named = re.findall(r"""["'](\w+-[\w-]+)["']""", cell.source)
    return list(dict.fromkeys(filter(None, shown))) or [n for n in named if n in words]


def _numbers(notebook: Any, words: Mapping[str, str]) -> dict[str, str]:
    """Return what each label is called, such as ``Table 2``, as the page of the chapter counts."""
    counted, found = Counter[str](), {}
    for cell in notebook.cells:
        if cell.cell_type == "code":
            labels = [("Fig." if n.startswith("fig") else "Table", n) for n in _shown(cell, words)]
        else:
            labels = [(_NUMBERED.get(k, k.removeprefix("prf:").capitalize()), label)
                      for k, label in _LABELLED.findall(cell.source)]  # fmt: skip
        for kind, label in labels:
            counted[kind] += 1
            found[label] = f"{kind} {counted[kind]}".strip()
    return found


def stale_twins(project: Project) -> dict[Path, str | None]:
    """Return the twins that are not what the sources and the published results give.

    That is their texts, None for one too many.
    """
    book, wanted = PlainBook(project), {}
    for chapter in project.chapters():
        published = reference_results(project, chapter.id)
        made = book.notebook(chapter, read_source(chapter), published, published=True)
        wanted[chapter.twin] = notebook_text(made)
    there = set((project.root / "chapters").rglob("[!.]*.ipynb"))
    return {
        path: wanted.get(path)
        for path in sorted(there | wanted.keys())
        if path not in there or path.read_bytes() != wanted.get(path, "").encode("utf-8")
    }


if __name__ == "__main__":
    for path, text in stale_twins(Project(find_root())).items():
        if text is None:
            path.unlink()
        else:
            write_whole(path, text)

"""Pages that are made from results: the page of claims, and what the build adds to a chapter."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import nbformat

from inswsn_book.ledger import KINDS, PAPERS, Claim, QuantityCheck
from inswsn_book.results import Provenance, Results
from inswsn_book.tables import list_table
from inswsn_book.verdicts import Judged, Verdict, count_verdicts

_FEW = 5  # claims that a line may name


def slug(word: str) -> str:
    """Return a word as part of a CSS class, as docutils writes it: ``"not-decided"``."""
    return word.lower().replace(" ", "-")


def with_links_and_provenance(notebook: Any, results: Results, claims: Sequence[Claim]) -> Any:
    """Add to a chapter what the build knows of it.

    Before each cell that decides claims goes a line that links to them, and is linked to by them;
    after the last cell goes the provenance of the run.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
        An executed notebook; it is changed in place.
    results : Results
        What it recorded.
    claims : sequence of Claim
        The claims that the chapter decides.

    Returns
    -------
    nbformat.NotebookNode
        The same notebook.
    """
    decided: dict[str, list[Claim]] = {}
    for claim in claims:
        if isinstance(claim.check, QuantityCheck) and claim.check.quantity in results.cells:
            cell = results.cells[claim.check.quantity]
            decided.setdefault(cell, []).append(claim)
    cells = []
    for cell in notebook.cells:
        if cell["id"] in decided:
            cells.append(_markdown(f"{cell['id']}-claims", _deciding(cell, decided)))
        cells.append(cell)
    if results.provenance is not None:
        text = provenance_text(results, results.provenance)
        cells.append(_markdown(f"ch{results.chapter}-provenance", text))
    notebook.cells = cells
    return notebook


def _markdown(identity: str, text: str) -> Any:
    cell = nbformat.v4.new_markdown_cell(text)
    cell["id"] = identity
    return cell


def _deciding(cell: Any, decided: dict[str, list[Claim]]) -> str:
    claims = decided[cell["id"]]
    which = "The next cell"
    if "remove-cell" in cell.metadata.get("tags", []):
        which = "A cell that is left out here, and is in the executed notebook,"
    links = ", ".join(f"[{claim.id}](#{claim.anchor})" for claim in claims)
    target = f"(cell-{cell['id']})=\n"
    if len(claims) > _FEW:
        title = f"{which} decides {len(claims)} claims"
        return f"{target}:::{{dropdown}} {title}\n:class-container: deciding\n{links}\n:::\n"
    several = "claims" if len(claims) > 1 else "claim"
    return f"{target}:::{{div}} deciding\n{which} decides the {several} {links}.\n:::\n"


def provenance_text(results: Results, made: Provenance) -> str:
    """Return the section that ends a chapter: what this run was made with, as MyST Markdown."""
    state = {None: "", True: ", without changes", False: ", with changes that were not committed"}
    commit = "unknown: not a git checkout" if made.commit is None else f"`{made.commit}`"
    seed = results.parameters.get("seed")
    rows = [
        (
            "parameters",
            ", ".join(f"{_code(f'{n} = {v}')}" for n, v in results.parameters.items()) or "none",
        ),
        ("seed", "none declared" if seed is None else f"`{seed}`"),
        ("inswsn", f"{made.version}, commit {commit}{state[made.clean]}"),
        ("SHA-256 of sources", _digests(made.sources)),
        ("SHA-256 of data", _digests(results.data) or "none read"),
        ("solvers", ", ".join(f"{n}: {s}" for n, s in results.solvers.items()) or "none called"),
        ("linear algebra", "; ".join(made.blas) or "unknown"),
        ("Python and packages", f"Python {made.python}, " + _versions(made)),
        ("machine", f"{made.cpu}, {made.cores} cores, {made.system}"),
        ("run", f"{made.seconds:g} s, ended {made.finished}"),
    ]
    table = list_table("", "", rows, header_rows=0, stub_columns=1, style="provenance")
    return (
        "## Provenance\n\nWhat the run on this page was made with. Digests in full are in "
        f"{{download}}`its results file </generated/{results.chapter}.json>`.\n\n"
        f"{table}"
    )


def _digests(files: Mapping[str, str]) -> str:
    # the results file has them in full
    return ", ".join(f"{_code(name)} `{digest[:12]}…`" for name, digest in files.items())


def _code(text: str) -> str:
    """Return a text as a code span, whatever is in it."""
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", text)), default=0))
    pad = " " if text.startswith("`") or text.endswith("`") else ""
    return f"{fence}{pad}{' '.join(text.split())}{pad}{fence}"


def _versions(made: Provenance) -> str:
    return ", ".join(f"{name} {version}" for name, version in made.packages.items())


def claims_list(judged: Sequence[Judged]) -> str:
    """Return all claims as MyST Markdown, each with a label of its own.

    Radio buttons filter them by style rules alone, so that the whole can be read, and filtered,
    without JavaScript.

    Parameters
    ----------
    judged : sequence of Judged
        The claims in the order of the ledger.
    """
    parts = [_filters(judged), *map(_entry, judged)]
    parts.append('```{raw} html\n<p class="claims-shown" aria-hidden="true"></p>\n```\n')
    return "\n".join(parts)


def claims_counts(judged: Sequence[Judged]) -> str:
    """Return a table of how many claims of each paper have each verdict, as MyST Markdown."""
    by_paper = {
        paper: Counter(entry.verdict for entry in judged if entry.claim.paper == paper)
        for paper in PAPERS
    }
    rows = [
        [str(verdict), *(str(by_paper[paper][verdict]) for paper in PAPERS), str(count)]
        for verdict, count in count_verdicts(judged).items()
    ]
    columns = [[int(row[i]) for row in rows] for i in range(1, len(PAPERS) + 2)]
    rows.append(["all", *(str(sum(column)) for column in columns)])
    caption = "Verdicts by paper, computed from the results of this build."
    return list_table(caption, "tbl-claims", [["verdict", *PAPERS, "all"], *rows], stub_columns=1)


def _filters(judged: Sequence[Judged]) -> str:
    """Return radio buttons by paper, kind and verdict, and the style rules that make them work."""
    groups = {
        "paper": [word for word in PAPERS if any(e.claim.paper == word for e in judged)],
        "kind": [word for word in KINDS if any(e.claim.kind == word for e in judged)],
        "verdict": [str(word) for word in Verdict if any(e.verdict is word for e in judged)],
    }
    lines = ["```{raw} html", '<form class="claims-filter" autocomplete="off">']
    rules = []
    for group, words in groups.items():
        lines.append(f"<fieldset><legend>{group}</legend>")
        for i, word in enumerate(["all", *words]):
            name = f"show-{group}-{i}"
            checked = " checked" if i == 0 else ""
            lines.append(
                f'<label><input type="radio" name="{group}" id="{name}"{checked}> '
                f"{escape(word)}</label>"
            )
            if i > 0:
                rules.append(
                    f"body:has(#{name}:checked) .claim:not(.{group}-{slug(word)}) {{display: none}}"
                )
        lines.append("</fieldset>")
    return "\n".join([*lines, "</form>", "<style>", *rules, "</style>", "```\n"])


def _entry(entry: Judged) -> str:
    claim = entry.claim
    classes = " ".join(
        (
            "claim",
            f"paper-{slug(claim.paper)}",
            f"kind-{claim.kind}",
            f"verdict-{slug(entry.verdict)}",
        )
    )
    lines = [
        f"({claim.anchor})=",
        f"::::{{div}} {classes}",
        f"**[{claim.id}](#{claim.anchor})** {claim.paper}, {claim.place} · {claim.kind} · "
        f"**{entry.verdict}**",
        "",
        claim.says,
        "",
    ]
    if entry.quantity is not None:
        basis = f"from {_BASES[entry.quantity.basis]}"
        if entry.quantity.runs > 1:
            basis += f", {entry.quantity.runs} runs"
        lines += [
            f"*Holds if:* {entry.published_text}. *Found* {basis}: {entry.rebuilt_text}.",
            f"{entry.quantity.how} {entry.reason}",
        ]
        # the reason of a verdict that an assumption carries names it already
        if claim.assumption and entry.verdict is not Verdict.ASSUMED:
            lines.append(f"Assumed: {claim.assumption}")
    else:
        lines.append(entry.reason)
    lines += ["", f"*Check:* {claim.why}{_decided_by(entry)}", "::::", ""]
    return "\n".join(lines)


_BASES = {
    "printed": "the paper's own printed numbers",
    "simulation": "a simulation",
    "emulation": "an emulation on recorded data",
    "recorded": "recorded data",
}


def _decided_by(entry: Judged) -> str:
    if entry.cell is None:
        return ""
    place = f"chapter {entry.claim.chapter}, cell {entry.cell}"
    return f" Decided in [{place}](#cell-{entry.cell})."

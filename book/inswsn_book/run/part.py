"""A cell of a chapter with what it needs, and nothing else: one check that runs in seconds."""

from __future__ import annotations

import ast
import symtable
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cached_property
from typing import Any

from inswsn_book.judge.ledger import Claim, QuantityCheck
from inswsn_book.record.parameters import nearest, read_myst
from inswsn_lib.errors import ParameterError

# what the record gives back of what was recorded; what else a chapter calls of it only adds to it
_ASKED = ("judge", "results", "show_claims")
_RECORD = "record"
# statements after which what they assign is bound; of others a branch may have been left out
_BINDING = (
    *(ast.FunctionDef, ast.ClassDef, ast.Assign, ast.AnnAssign, ast.Import, ast.ImportFrom),
    *(ast.Expr, ast.Assert),
)


@dataclass(frozen=True)
class Cell:
    """A code cell, by the names that it takes from others and leaves for them."""

    source: str

    @cached_property
    def _tree(self) -> ast.Module:
        return ast.parse(self.source)

    @cached_property
    def changed(self) -> frozenset[str]:
        """Names that it binds or whose objects it changes: by an index, an attribute, a method."""
        names = {s.get_name() for s in self._table.get_symbols() if _binds(s)}
        for node in ast.walk(self._tree):
            inner: Any = None
            if isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store):
                inner = node
            elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
                inner = node.value.func if isinstance(node.value.func, ast.Attribute) else None
            while isinstance(inner, ast.Attribute | ast.Subscript):
                inner = inner.value
            if isinstance(inner, ast.Name) and inner.id != _RECORD:
                names.add(inner.id)
        return frozenset(names)

    @property
    def taken(self) -> frozenset[str]:
        """Names that it takes from the cells before."""
        return self._flow[0]

    @property
    def made(self) -> frozenset[str]:
        """Names that it binds anew, whatever they were before it."""
        return self._flow[1]

    @cached_property
    def _flow(self) -> tuple[frozenset[str], frozenset[str]]:
        taken, bound = _flow(self._tree.body, frozenset())
        return taken, bound - taken

    @cached_property
    def later(self) -> frozenset[str]:
        """Names that its functions take when they are called, which may be bound after it."""
        inner = self._table.get_children()
        return frozenset(name for table in inner for name in _globals(table))

    @cached_property
    def _table(self) -> symtable.SymbolTable:
        return symtable.symtable(self.source, "cell", "exec")

    def asks_record(self) -> bool:
        """Tell whether it asks for what was recorded before it."""
        calls = [n.func for n in ast.walk(self._tree) if isinstance(n, ast.Call)]
        return any(getattr(f, "attr", getattr(f, "id", "")) in _ASKED for f in calls)


def _flow(
    statements: Sequence[ast.stmt], bound: frozenset[str]
) -> tuple[frozenset[str], frozenset[str]]:
    """Return what statements take that is not bound before, and what is surely bound after them."""
    taken = frozenset[str]()
    for statement in statements:
        if isinstance(statement, ast.For):  # it may have no turn: what it binds holds inside
            taken |= _names(statement.iter) - bound
            inner = _flow(statement.body, bound | _names(statement.target))[0]
            taken |= inner | _flow(statement.orelse, bound)[0]
        elif isinstance(statement, ast.If):
            taken |= _names(statement.test) - bound
            ways = [_flow(way, bound) for way in (statement.body, statement.orelse)]
            taken |= ways[0][0] | ways[1][0]
            bound = ways[0][1] & ways[1][1]
        elif isinstance(statement, ast.With):
            for item in statement.items:
                taken |= _names(item.context_expr) - bound
                bound |= _names(item.optional_vars) if item.optional_vars else frozenset()
            inner, bound = _flow(statement.body, bound)
            taken |= inner
        elif isinstance(statement, ast.Try):  # what it binds is not sure after it
            taken |= _flow([*statement.body, *statement.orelse, *statement.finalbody], bound)[0]
            for handler in statement.handlers:
                taken |= _names(handler.type) - bound if handler.type else frozenset()
                taken |= _flow(handler.body, bound | {handler.name or ""})[0]
        else:
            table = symtable.symtable(ast.unparse(statement), "cell", "exec")
            taken |= frozenset(_globals(table)) - bound
            if isinstance(statement, _BINDING):
                bound |= {s.get_name() for s in table.get_symbols() if _binds(s)}
    return taken, bound


def _binds(symbol: symtable.Symbol) -> bool:
    return symbol.is_assigned() or symbol.is_imported()


def _names(part: ast.expr) -> frozenset[str]:
    """Return the names in an expression; of a target also those of what it changes."""
    if isinstance(getattr(part, "ctx", None), ast.Store):
        return frozenset(node.id for node in ast.walk(part) if isinstance(node, ast.Name))
    return frozenset(_globals(symtable.symtable(ast.unparse(part), "cell", "eval")))


def _globals(table: symtable.SymbolTable) -> Iterator[str]:
    top = table.get_type() == "module"
    for symbol in table.get_symbols():
        if symbol.is_referenced() and (top or symbol.is_global()):
            yield symbol.get_name()
    for child in table.get_children():
        yield from _globals(child)


def needed(cells: Sequence[Cell], wanted: Iterable[int], recording: Iterable[int]) -> list[int]:
    """Return the places of the wanted cells and of those that they need, in their order.

    Parameters
    ----------
    cells : sequence of Cell
        Of a chapter.
    wanted : iterable of int
        Places of the cells that are asked for.
    recording : iterable of int
        Places of the cells that record: what asks for what was recorded needs those before it.
    """
    wanted, recording, kept = {*wanted}, {*recording}, set[int]()
    later: set[str] = set()
    while True:
        found, names, asked = set[int](), set(later), False
        for place in range(max(wanted), -1, -1):
            cell = cells[place]
            if place in wanted or cell.changed & names or (asked and place in recording):
                found.add(place)
                asked = asked or cell.asks_record()
                names = (names - cell.made) | cell.taken
        more = set().union(*(cells[place].later for place in found))
        if found == kept and more <= later:
            return sorted(found)
        kept, later = found, later | more


@dataclass(frozen=True)
class Part:
    """The source of a part of a chapter, and the quantities in it that were asked for."""

    source: str
    quantities: frozenset[str]


def aligned(published: Mapping[int, str], cells: Mapping[int, str]) -> dict[int, int]:
    """Return where the cells of a published chapter stand in it today, by their places.

    Cells that are gone have no place; an edited one has that of what stands where it stood.
    """
    before, now = list(published), list(cells)
    texts = list(published.values()), list(cells.values())
    places: dict[int, int] = {}
    for what, i, end, j, last in SequenceMatcher(None, *texts, autojunk=False).get_opcodes():
        if what in ("equal", "replace"):
            places |= {before[end - 1 - k]: now[max(last - 1 - k, j)] for k in range(end - i)}
    return places


def alone(
    source: str,
    name: str,
    asked: str,
    places: Mapping[str, str],
    claims: Iterable[Claim],
    published: Mapping[int, str] | None = None,
) -> Part:
    """Return the part of a chapter that has the parameters and the cells asked for alone.

    Parameters
    ----------
    source, name : str
        Of the chapter, and what it is called.
    asked : str
        The id of a claim, the name of a quantity, the first parts of names, or the label of a table
        or figure, with or without what comes before it (``tbl-p1-training-table2``, ``table2``).
    places : mapping of str to str
        The id of the cell that records each quantity; its last part is the place of the cell.
    claims : iterable of Claim
        Those that the chapter decides.
    published : mapping of int to str, optional
        The code of the cells to which `places` refer, by place, if the chapter has been edited.

    Raises
    ------
    ParameterError
        If nothing has that name.
    """
    notebook = read_myst(source, name)
    code = [i for i, cell in enumerate(notebook.cells) if cell.cell_type == "code"]
    cells = [Cell(notebook.cells[i].source) for i in code]
    decided = {c.id: c.check.quantity for c in claims if isinstance(c.check, QuantityCheck)}
    quantity = decided.get(asked, asked)
    now = {i: notebook.cells[i].source for i in code}
    today = aligned(published or now, now)
    numbers = {each: today.get(int(cell.rpartition("-")[2])) for each, cell in places.items()}
    at = {each: code.index(i) for each, i in numbers.items() if i is not None}
    labels = {
        word.value: place
        for place, cell in enumerate(cells)
        for word in ast.walk(ast.parse(cell.source))
        if isinstance(word, ast.Constant) and isinstance(word.value, str)
        if word.value.startswith(("tbl-", "fig-"))
    }
    known = labels | {label.split("-", 1)[1]: place for label, place in labels.items()}
    known |= {label.removeprefix(f"{name}-"): p for label, p in known.items()} | at
    quantities = {each for each in at if each == quantity or each.startswith(f"{asked}.")}
    wanted = {at[each] for each in quantities} | ({known[asked]} if asked in known else set())
    quantities |= set() if quantities else {each for each, place in at.items() if place in wanted}
    if not wanted:
        hint = nearest(asked, [*decided, *known], 0.4)
        raise ParameterError("--only", asked, f"a claim, a quantity or a table of {name}{hint}")
    parameters = next(i for i, c in zip(code, cells, strict=True) if _declares(notebook.cells[i]))
    kept = {code[place] for place in needed(cells, wanted, at.values())} | {parameters}
    lines = source.split("\n---\n", 1)[0] + "\n---\n"
    for place in sorted(kept):
        tags = "\n:tags: [parameters]" if place == parameters else ""
        lines += f"\n```{{code-cell}} ipython3{tags}\n\n{notebook.cells[place].source}\n```\n"
    ended = f"{lines}\n```{{code-cell}} ipython3\n\nrecord.write();\n```\n"
    return Part(ended, frozenset(quantities))


def _declares(cell: Any) -> bool:
    return "parameters" in cell.metadata.get("tags", [])

"""Finds circles of imports between the modules of packages, however a module takes another."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

import networkx as nx


class Imports:
    """What each module of some packages takes from which.

    Imports count wherever they stand: inside functions, relative ones, and attributes of an
    imported package. A name that a package takes over from a module below it, by an import or by
    the stub whose names it imports on demand, leads to that module.
    """

    def __init__(self, packages: Iterable[Path]) -> None:
        self._trees: dict[str, ast.Module] = {}
        self._faces: set[str] = set()
        for package in packages:
            for path in package.rglob("*.py"):
                parts = path.with_suffix("").relative_to(package.parent).parts
                name = ".".join(parts).removesuffix(".__init__")
                texts = [
                    p.read_text("utf-8") for p in (path, path.with_suffix(".pyi")) if p.is_file()
                ]
                self._trees[name] = ast.parse("\n".join(texts))
                self._faces |= {name} if path.stem == "__init__" else set()
        # where the names lead that a package takes over
        self._homes = {face: self._bound(face) for face in self._faces}

    def circles(self) -> list[list[str]]:
        """Return the circles, each as the sorted names of its modules."""
        graph = nx.DiGraph()
        for name in self._trees:
            found = (self._home(wanted) for wanted in self._wanted(name))
            graph.add_edges_from((name, home) for home in found if home not in {None, name})
        found = nx.strongly_connected_components(graph)
        return sorted(sorted(group) for group in found if len(group) > 1)

    def _bound(self, name: str) -> dict[str, str]:
        """Return what the names that a module imports stand for, from their package on."""
        bound: dict[str, str] = {}
        for node in ast.walk(self._trees[name]):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    first = alias.name.partition(".")[0]
                    bound |= {alias.asname: alias.name} if alias.asname else {first: first}
            elif isinstance(node, ast.ImportFrom):
                source = self._source(name, node)
                bound |= {a.asname or a.name: f"{source}.{a.name}" for a in node.names}
        return bound

    def _wanted(self, name: str) -> Iterator[str]:
        """Return what a module takes, each as a dotted name from its package on."""
        bound = self._bound(name)
        yield from bound.values()
        for node in ast.walk(self._trees[name]):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.Attribute):
                first, *rest = ast.unparse(node).split(".")
                if first in bound:
                    yield ".".join([bound[first], *rest])

    def _source(self, name: str, node: ast.ImportFrom) -> str:
        if not node.level:
            return node.module or ""
        parts = name.split(".")
        up = node.level - (name in self._faces)
        return ".".join([*parts[: len(parts) - up], *([node.module] if node.module else [])])

    def _home(self, wanted: str) -> str | None:
        """Return the module that a dotted name leads to, None if it is none of ours."""
        module, rest = wanted, list[str]()
        while module and module not in self._trees:
            module, _, last = module.rpartition(".")
            rest.insert(0, last)
        home = self._homes.get(module, {}).get(rest[0]) if rest else None
        if home is not None and home != f"{module}.{rest[0]}":
            return self._home(".".join([home, *rest[1:]]))
        return module or None

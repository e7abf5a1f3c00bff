"""Finds circles of imports between the modules of packages, however a module takes another."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import networkx as nx

# such as "inswsn_lib.navigation:training_areas", for an import by name
_NAMED = re.compile(r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(:[A-Za-z_]\w*)?$")


def modules(package: Path) -> dict[str, Path]:
    """Return the modules of a package, by their names."""
    return {
        ".".join(path.with_suffix("").relative_to(package.parent).parts).removesuffix(
            ".__init__"
        ): path
        for path in package.rglob("*.py")
    }


class Imports:
    """What each module of some packages takes from which.

    Imports count wherever they stand: inside functions, relative ones, and texts that name a module
    or a name in it, as tables of names imported on demand have them. A name that a package takes
    over from a module below it leads to that module.
    """

    def __init__(self, packages: Iterable[Path]) -> None:
        self._paths = {n: p for package in packages for n, p in modules(package).items()}
        self._trees = {n: ast.parse(p.read_text(encoding="utf-8")) for n, p in self._paths.items()}
        self._faces = {n for n, p in self._paths.items() if p.name == "__init__.py"}
        self._homes = {name: dict(self._taken_over(name)) for name in self._faces}

    def circles(self) -> list[list[str]]:
        """Return the circles, each as the sorted names of its modules."""
        graph = nx.DiGraph()
        for name in self._paths:
            graph.add_edges_from((name, used) for used in self._used(name) if used != name)
        found = nx.strongly_connected_components(graph)
        return sorted(sorted(group) for group in found if len(group) > 1)

    def _used(self, name: str) -> Iterator[str]:
        for module, member in self._imported(name):
            yield from self._home(module, member)

    def _imported(self, name: str) -> Iterator[tuple[str, str]]:
        """Return what a module takes: modules, and names in them or empty."""
        for node in ast.walk(self._trees[name]):
            if isinstance(node, ast.Import):
                yield from ((alias.name, "") for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                module = self._absolute(name, node)
                yield from ((module, alias.name) for alias in node.names)
            elif isinstance(node, ast.Constant) and _NAMED.match(str(node.value)):
                module, _, member = str(node.value).partition(":")
                yield module, member

    def _absolute(self, name: str, node: ast.ImportFrom) -> str:
        if not node.level:
            return node.module or ""
        parts = name.split(".")
        up = node.level - (name in self._faces)
        return ".".join([*parts[: len(parts) - up], *([node.module] if node.module else [])])

    def _home(self, module: str, member: str) -> Iterator[str]:
        """Return the module that a name is defined in."""
        if f"{module}.{member}" in self._paths:
            yield f"{module}.{member}"
        elif member in self._homes.get(module, {}):
            yield from self._home(*self._homes[module][member])
        elif module in self._paths and not (module in self._faces and not member):
            yield module

    def _taken_over(self, face: str) -> Iterator[tuple[str, tuple[str, str]]]:
        """Return the names that a package offers from elsewhere: imported, or on demand."""
        for node in self._trees[face].body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    yield alias.asname or alias.name, (self._absolute(face, node), alias.name)
        for node in ast.walk(self._trees[face]):
            if isinstance(node, ast.Dict):
                for key, value in zip(node.keys, node.values, strict=True):
                    if isinstance(key, ast.Constant) and isinstance(value, ast.Constant):
                        module, _, member = str(value.value).partition(":")
                        module = face + module if module.startswith(".") else module
                        if module in self._paths:
                            yield str(key.value), (module, member or str(key.value))

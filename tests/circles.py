"""Finds circles of imports between the modules of packages, however a module takes another."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import networkx as nx

# such as "inswsn_lib.navigation:TrainingAreas" or ".inner", for an import by name
_NAMED = re.compile(r"\.?[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(:[A-Za-z_]\w*)?")


def modules(package: Path) -> dict[str, Path]:
    """Return the modules of a package, by their names."""
    return {
        ".".join(path.with_suffix("").relative_to(package.parent).parts).removesuffix(
            ".__init__"
        ): path
        for path in package.rglob("*.py")
    }


def _text(path: Path) -> str:
    """Return a module, and behind it the stub whose names it imports on demand, if there is one."""
    stub = path.with_suffix(".pyi")
    texts = [each.read_text(encoding="utf-8") for each in (path, stub) if each.is_file()]
    return "\n".join(texts)


class Imports:
    """What each module of some packages takes from which.

    Imports count wherever they stand: inside functions, relative ones, attributes of an imported
    package, and texts that name a module or a name in it, as tables of names imported on demand
    have them. A name that a package takes over from a module below it leads to that module.
    """

    def __init__(self, packages: Iterable[Path]) -> None:
        self._paths = {n: p for package in packages for n, p in modules(package).items()}
        self._trees = {n: ast.parse(_text(p)) for n, p in self._paths.items()}
        self._faces = {n for n, p in self._paths.items() if p.name == "__init__.py"}
        self._homes: dict[str, dict[str, str]] = {}
        self._homes |= {name: dict(self._taken_over(name)) for name in self._faces}

    def circles(self) -> list[list[str]]:
        """Return the circles, each as the sorted names of its modules."""
        graph = nx.DiGraph()
        for name in self._paths:
            found = (self._home(wanted) for wanted in self._wanted(name))
            graph.add_edges_from((name, home) for home in found if home not in {None, name})
        found = nx.strongly_connected_components(graph)
        return sorted(sorted(group) for group in found if len(group) > 1)

    def _wanted(self, name: str) -> Iterator[str]:
        """Return what a module takes, each as a dotted name from its package on."""
        nodes = list(ast.walk(self._trees[name]))
        bound: dict[str, str] = {}
        for node in nodes:
            if isinstance(node, ast.Import):
                for alias in node.names:
                    first = alias.name.partition(".")[0]
                    bound |= {alias.asname: alias.name} if alias.asname else {first: first}
                    yield alias.name
            elif isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    bound[alias.asname or alias.name] = f"{self._source(name, node)}.{alias.name}"
                    yield bound[alias.asname or alias.name]
            elif isinstance(node, ast.Constant) and _NAMED.fullmatch(str(node.value)):
                yield from self._named(name, str(node.value))
        for node in nodes:
            if isinstance(node, ast.Attribute):
                first, *rest = ast.unparse(node).split(".")
                if first in bound:
                    yield ".".join([bound[first], *rest])

    def _named(self, name: str, text: str) -> Iterator[str]:
        """Return the dotted names that a text may mean in a module."""
        wanted = text.replace(":", ".")
        yield wanted
        # a table of names may leave out the package: ".inner" or "inner" for what lies beside
        room = name if name in self._faces else name.rpartition(".")[0]
        beside = f"{room}.{wanted.removeprefix('.')}"
        first = f"{room}.{wanted.removeprefix('.').partition('.')[0]}"
        if (wanted[0] == "." or name in self._faces) and first in self._paths:
            yield beside

    def _source(self, name: str, node: ast.ImportFrom) -> str:
        if not node.level:
            return node.module or ""
        parts = name.split(".")
        up = node.level - (name in self._faces)
        return ".".join([*parts[: len(parts) - up], *([node.module] if node.module else [])])

    def _home(self, wanted: str) -> str | None:
        """Return the module that a dotted name leads to, None if it is none of ours."""
        module, rest = wanted, list[str]()
        while module and module not in self._paths:
            module, _, last = module.rpartition(".")
            rest.insert(0, last)
        if rest and rest[0] in self._homes.get(module, {}):
            return self._home(".".join([self._homes[module][rest[0]], *rest[1:]]))
        return module or None

    def _taken_over(self, face: str) -> Iterator[tuple[str, str]]:
        """Return the names that a package offers from elsewhere: imported, or on demand."""
        for node in ast.walk(self._trees[face]):
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    wanted = f"{self._source(face, node)}.{alias.name}"
                    if wanted != f"{face}.{alias.name}":
                        yield alias.asname or alias.name, wanted
            elif isinstance(node, ast.Dict):
                for key, value in zip(node.keys, node.values, strict=True):
                    texts = [n.value for n in (key, value) if isinstance(n, ast.Constant)]
                    if len(texts) == 2 and isinstance(texts[1], str) and texts[1]:
                        for wanted in self._named(face, texts[1]):
                            # a table names the module alone, or the module and the name in it
                            member = f".{texts[0]}" if wanted in self._paths else ""
                            if self._home(wanted) is not None:
                                yield str(texts[0]), wanted + member

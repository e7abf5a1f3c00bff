"""What each module of some packages takes from which, and what a piece of code needs of them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Self

from inswsn_book.record.files import Memory, file_digest, text_digest

_WORD = re.compile(r"[a-z_][\w.]*")


class Named(NamedTuple):
    """What a piece of code names.

    `bound` has what its names of modules and of their members stand for, `wanted` all dotted names
    that lead from them, `packages` where they come from, `words` the strings that may name modules.
    """

    bound: dict[str, str]
    wanted: list[str]
    packages: list[str]
    words: list[str]

    @classmethod
    def of(cls, tree: ast.Module, package: str = "") -> Self:
        """Read what a module names that lies in a package; imports may be relative to that."""
        bound: dict[str, str] = {}
        packages, wanted, words = set[str](), set[str](), set[str]()
        nodes = list(ast.walk(tree))
        for node in nodes:
            if isinstance(node, ast.Import):
                wanted |= {alias.name for alias in node.names}
                for alias in node.names:
                    first = alias.name.partition(".")[0]
                    bound |= {alias.asname: alias.name} if alias.asname else {first: first}
            elif isinstance(node, ast.ImportFrom):
                source = _source(package, node)
                packages.add(source)
                bound |= {a.asname or a.name: f"{source}.{a.name}" for a in node.names}
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                words |= {node.value} if _WORD.fullmatch(node.value) else set()
        for node in nodes:
            first, *rest = _dotted(node)
            if rest and first in bound:
                wanted.add(".".join([bound[first], *rest]))
        wanted |= {*bound.values()}
        return cls(bound, sorted(wanted), sorted(packages), sorted(words))


def _source(package: str, node: ast.ImportFrom) -> str:
    """Return the dotted name of what an import takes names from."""
    if not node.level:
        return node.module or ""
    parts = package.split(".")
    above = parts[: len(parts) - node.level + 1]
    return ".".join([*above, *([node.module] if node.module else [])])


def _dotted(node: ast.AST) -> list[str]:
    """Return the names of an attribute such as ``a.b.c``; nothing for any other code."""
    names: list[str] = []
    while isinstance(node, ast.Attribute):
        names.insert(0, node.attr)
        node = node.value
    return [node.id, *names] if names and isinstance(node, ast.Name) else [""]


class _Module(NamedTuple):
    """A module: the digest of its code, and what it and its stub name."""

    digest: str
    own: Named
    stub: Named | None


class Imports:
    """What each module of some packages takes from which.

    Imports count wherever they stand: inside functions, relative ones, and attributes of an
    imported package. A name that a package takes over from a module below it, by an import or by
    the stub whose names it imports on demand, leads to that module. A string counts that is the
    name of a module below a package from which something is imported, as kernels are chosen.
    """

    def __init__(self, packages: Iterable[Path], memory: Memory | None = None) -> None:
        memory = memory or Memory()
        self._modules: dict[str, _Module] = {}
        self._faces: set[str] = set()
        for package in packages:
            for path in filter(lambda path: path.suffix == ".py", code_files(package)):
                parts = path.with_suffix("").relative_to(package.parent).parts
                name, stub = ".".join(parts).removesuffix(".__init__"), path.with_suffix(".pyi")
                digests = [file_digest(p) for p in (path, stub) if p.is_file()]
                digest, own, named = memory.of(" ".join([name, *digests]), _read, path, stub, name)
                self._modules[name] = _Module(digest, Named(*own), Named(*named) if named else None)
                self._faces |= {name} if path.stem == "__init__" else set()
        # where the names lead that a package takes over
        self._homes = {
            face: self._modules[face].own.bound | getattr(self._modules[face].stub, "bound", {})
            for face in self._faces
        }

    def edges(self) -> set[tuple[str, str]]:
        """Return pairs of modules of which the first takes something of the second."""
        named = ((name, part) for name, m in self._modules.items() for part in (m.own, m.stub))
        return {(name, h) for name, part in named if part for h in self._homes_of(part) - {name}}

    def needs(self, named: Named) -> set[str]:
        """Return the modules that a piece of code may load, however deep.

        Of a package, what its own file names counts; what its stub names counts where it is asked
        for.
        """
        left, found = self._homes_of(named), set[str]()
        while left:
            name = left.pop()
            if name not in found:
                found.add(name)
                left |= self._homes_of(self._modules[name].own)
                left |= {name.rpartition(".")[0]} & self._faces
        return found

    def digest(self, modules: Iterable[str]) -> str:
        """Return a digest of the code of modules: not of comments, docstrings and form."""
        return text_digest("".join(f"{m}\0{self._modules[m].digest}\n" for m in sorted(modules)))

    @cached_property
    def modules(self) -> frozenset[str]:
        """The names of all modules."""
        return frozenset(self._modules)

    def _homes_of(self, named: Named) -> set[str]:
        """Return the modules of ours that names lead to."""
        # "__main__" is the word for a script, and no module that is asked for
        words = {*named.words} - {"__main__"}
        below = (f"{package}.{word}" for package in named.packages for word in words)
        strings = {name for name in (*named.words, *below) if name in self._modules}
        return strings | {home for wanted in named.wanted if (home := self._home(wanted))}

    def _home(self, wanted: str) -> str | None:
        """Return the module that a dotted name leads to, None if it is none of ours."""
        module, rest = wanted, list[str]()
        while module and module not in self._modules:
            module, _, last = module.rpartition(".")
            rest.insert(0, last)
        home = self._homes.get(module, {}).get(rest[0]) if rest else None
        if home is not None and home != f"{module}.{rest[0]}":
            return self._home(".".join([home, *rest[1:]]))
        return module or None


def code_files(package: Path) -> list[Path]:
    """Return the modules and stubs of a package, in order; not what is compiled of them."""
    return sorted(p for p in package.rglob("*.py*") if p.suffix in (".py", ".pyi"))


def _read(path: Path, stub: Path, name: str) -> tuple[str, Named, Named | None]:
    """Return the digest of a module's code, and what it and its stub name."""
    package = name if path.stem == "__init__" else name.rpartition(".")[0]
    tree = ast.parse(path.read_text("utf-8"))
    own = Named.of(tree, package)
    named = Named.of(ast.parse(stub.read_text("utf-8")), package) if stub.is_file() else None
    return code_digest(tree), own, named


def code_digest(tree: ast.Module) -> str:
    """Return a digest of what a module does: comments and docstrings do not count."""
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return text_digest(ast.dump(tree))


_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)

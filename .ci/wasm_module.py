"""What a module of WebAssembly takes from others and gives them, read from its bytes.

A library that is linked apart from Pyodide may want a function that Pyodide does not have, or has
with another type. Neither is told before the function is called, in the reader's page; so the
build of numpy compares all of them here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

#: Parameters and results of a function, as the bytes of a module have them
Signature = tuple[bytes, bytes]
_TYPES, _IMPORTS, _FUNCTIONS, _EXPORTS = 1, 2, 3, 7
_FUNCTION, _TABLE, _MEMORY, _GLOBAL, _TAG = range(5)


class Module(NamedTuple):
    """The names of a module; what is no function has no signature."""

    imports: dict[tuple[str, str], Signature | None]
    exports: dict[str, Signature | None]


class _Reader:
    """Reads numbers and names one after the other."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def byte(self) -> int:
        """Return one byte."""
        self.at += 1
        return self.content[self.at - 1]

    def number(self) -> int:
        """Return a number of seven bits a byte, the lowest first."""
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    def part(self) -> bytes:
        """Return bytes whose number stands before them."""
        size = self.number()
        self.at += size
        if self.at > len(self.content):
            raise ValueError("a part of the module is cut short")
        return self.content[self.at - size : self.at]

    def name(self) -> str:
        """Return a name."""
        return self.part().decode()

    def limits(self) -> None:
        """Pass over the bounds of a memory or a table."""
        bounded = self.byte() & 1
        for _ in range(1 + bounded):
            self.number()


def read(content: bytes) -> Module:
    """Read what a module imports and exports; what is no module is a `ValueError`."""
    if content[:8] != b"\0asm\1\0\0\0":
        raise ValueError("this is no module of WebAssembly")
    found = dict(_sections(content[8:]))
    types = [_signature(part) for part in _entries(found, _TYPES)]
    imports = [_import(part, types) for part in _entries(found, _IMPORTS)]
    functions = [signature for *_, kind, signature in imports if kind == _FUNCTION]
    functions += [types[part.number()] for part in _entries(found, _FUNCTIONS)]
    exports: dict[str, Signature | None] = {}
    for part in _entries(found, _EXPORTS):
        name, kind, index = part.name(), part.byte(), part.number()
        exports[name] = functions[index] if kind == _FUNCTION else None
    return Module({(place, name): s for place, name, _, s in imports}, exports)


def _sections(content: bytes) -> Iterator[tuple[int, bytes]]:
    reader = _Reader(content)
    while reader.at < len(content):
        yield reader.byte(), reader.part()


def _entries(sections: Mapping[int, bytes], which: int) -> Iterator[_Reader]:
    """Give the reader of a section once for each of its entries."""
    reader = _Reader(sections.get(which, b"\0"))
    for _ in range(reader.number()):
        yield reader


def _signature(reader: _Reader) -> Signature:
    if reader.byte() != 0x60:
        raise ValueError("the module has a type that is no function")
    return reader.part(), reader.part()


def _import(reader: _Reader, types: list[Signature]) -> tuple[str, str, int, Signature | None]:
    place, name, kind = reader.name(), reader.name(), reader.byte()
    if kind == _FUNCTION:
        return place, name, kind, types[reader.number()]
    if kind == _TABLE:
        reader.byte()
        reader.limits()
    elif kind == _MEMORY:
        reader.limits()
    elif kind == _GLOBAL:
        reader.at += 2
    elif kind == _TAG:
        reader.byte()
        reader.number()
    else:
        raise ValueError(f"the module imports {name}, of an unknown kind")
    return place, name, kind, None


#: What the loader of libraries gives each of them
_LOADER = {
    "memory",
    "__indirect_function_table",
    "__stack_pointer",
    "__memory_base",
    "__table_base",
}


def misfits(library: Module, main: Module) -> list[str]:
    """Return what a library wants of the main module in vain, and what is of another type there.

    What the main module itself imports, from the program that loads both, is there as well.
    """
    there = {name: s for (place, name), s in main.imports.items() if place == "env"} | main.exports
    found = []
    for (place, name), wanted in library.imports.items():
        if (
            place not in ("env", "GOT.func", "GOT.mem")
            or name in library.exports
            or name in _LOADER
        ):
            continue
        if name not in there:
            found.append(f"{name} is missing")
        elif wanted is not None and there[name] != wanted:
            found.append(f"{name} has another type")
    return found

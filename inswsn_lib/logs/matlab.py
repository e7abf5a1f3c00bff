"""Tables of numbers in a MATLAB file of level 5, such as MATLAB writes by default.

``scipy.io.loadmat`` ends the whole process where such a file is spoilt, so the few elements that
are needed are read here.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_bytes
from inswsn_lib.logs.rows import reading

#: The type and the bytes of each element
Elements = Iterator[tuple[int, bytes]]

_HEAD = 128  # bytes: a text, the version, and the order of bytes
_MATRIX, _PACKED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8",
            13: "u8"}  # fmt: skip
_FULL = range(6, 16)  # classes of arrays of numbers: no cells, structures, texts, sparse ones
_LARGEST = 10**8  # bytes of an element when it is unpacked


def read_tables(path: Path) -> dict[str, Array]:
    """Return the matrices of real numbers in a MATLAB file, by their names."""
    with reading(path):
        data = read_bytes(path)
        order = {b"IM": "<", b"MI": ">"}.get(data[_HEAD - 2 : _HEAD], "")
        if not order:
            raise InswsnError("it is not a MATLAB file of level 5.")
        return dict(_matrices(_unpacked(_elements(data[_HEAD:], order), order), order))


def _elements(data: bytes, order: str) -> Elements:
    """Yield the elements that stand one after the other."""
    at = 0
    while at < len(data):
        if len(data) < at + 8:
            raise InswsnError("it ends too early.")
        kind, size = struct.unpack_from(f"{order}II", data, at)
        begin = at + 8
        if small := kind >> 16:  # up to four bytes stand in the head itself
            kind, size, begin = kind & 0xFFFF, small, at + 4
        if begin + size > len(data):
            raise InswsnError("it ends too early.")
        yield kind, data[begin : begin + size]
        at = at + 8 if small else begin + size + (0 if kind == _PACKED else -size % 8)


def _unpacked(elements: Elements, order: str) -> Elements:
    """Yield the elements, and those that are packed in one in its place."""
    for kind, body in elements:
        if kind != _PACKED:
            yield kind, body
            continue
        unpacker = zlib.decompressobj()
        try:
            data = unpacker.decompress(body, _LARGEST)
        except zlib.error:
            raise InswsnError("what it has packed cannot be unpacked.") from None
        if not unpacker.eof:
            raise InswsnError(f"it ends too early, or has packed more than {_LARGEST} bytes.")
        yield from _elements(data, order)


def _matrices(elements: Elements, order: str) -> Iterator[tuple[str, Array]]:
    """Yield name and numbers of each matrix; its elements are flags, shape, name and numbers."""
    for kind, body in elements:
        parts = list(_elements(body, order)) if kind == _MATRIX else []
        if len(parts) < 4 or np.frombuffer(parts[0][1], f"{order}u4")[0] & 0xFF not in _FULL:
            continue
        (_, shape), (_, name), (type_, values) = parts[1:4]
        if type_ not in _NUMBERS:
            raise InswsnError(f"it has numbers of the type {type_}, which are not read.")
        sizes = np.frombuffer(shape, f"{order}i4").tolist()
        numbers = np.frombuffer(values, order + _NUMBERS[type_]).astype(float)
        yield name.decode("ascii"), numbers.reshape(sizes, order="F")

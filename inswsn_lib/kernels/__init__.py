"""Inner loops that numpy cannot vectorise, compiled by numba.

Each file holds the loops of one kernel, in the part of Python that numba compiles, and calls no
other file of this room: numba does not see that a function of another file has changed. The plain
numpy that a kernel is tested against stands where it is called from, and `choose` says which of the
two runs, by the size of the work. What is compiled is kept on disk, so that it is compiled once and
not in each process.
"""

from inswsn_lib.kernels.choice import PLAIN, choose, compiled, import_numba_user, keeping

__all__ = ["PLAIN", "choose", "compiled", "import_numba_user", "keeping"]

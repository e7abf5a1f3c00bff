"""Inner loops that numpy cannot vectorise, compiled by numba.

Each file holds the loops of one kernel, in the part of Python that numba compiles, and calls no
other file of this room: numba does not see that a function of another file has changed. `choose`
says by the size of the work whether a kernel is compiled, or runs as the Python that it is. A few
have a form in plain numpy besides, which stands where it is called from. What is compiled is kept
on disk, so that it is compiled once and not in each process.
"""

from inswsn_lib.kernels.choice import PLAIN, choose, compiled, keeping, kernel

__all__ = ["PLAIN", "choose", "compiled", "keeping", "kernel"]

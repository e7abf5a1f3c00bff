"""What the papers print: their tables and numbers, with the rounding that the digits carry.

A printed number stands for every value that rounds to it. All arithmetic on printed numbers in
this book is therefore interval arithmetic: a statement of a paper is contradicted by the paper's
own cells only if no values that round to the cells can give it.
"""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)

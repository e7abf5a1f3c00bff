"""Methods and forensics of three papers on integrated navigation.

The rooms of the library, and what each may use, are listed in ``CONTRIBUTING.md``;
the chapters in ``chapters/`` show every one of them at work.
"""

from importlib.metadata import version

__version__ = version("inswsn")

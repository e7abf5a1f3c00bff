"""Methods and forensics of three papers on integrated navigation.

``import inswsn_lib as iw`` gives every name that an engineer needs, imported when it is first used:
a model, a filter, a design, a recording, a learner, a score. `__init__.pyi` lists them. The rooms,
and what each may use, are listed in ``CONTRIBUTING.md``.
"""

from importlib.metadata import version

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = version("inswsn")

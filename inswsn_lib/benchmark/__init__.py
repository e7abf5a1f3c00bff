"""The benchmark that others enter: tracks, fixed splits, required baselines, a separate process.

An entry is a class or a function in a file. It gets what will come (`Task`), is given what
sensors said one event after the other, and answers when it is asked where the tag is.

.. code-block:: python

    from inswsn_lib.benchmark import Answer


    class StandStill:
        tunable = {}

        def __init__(self, task):
            self.last = None

        def step(self, event):
            if event.kind == "fix":
                self.last = event.values[:2]
            if event.kind == "ask" and self.last is not None:
                return Answer(self.last)

What stands between an entry and what it may not see is a guard against mistakes, not a jail: the
process is given nothing but the past; files but its own, the network and other programs are
refused; everything is turned, shifted and delayed at random; changed data after a time must leave
the answers before it as they were. Who wants to cheat can.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

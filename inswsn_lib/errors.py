"""The errors that a user can cause, each one sentence long."""

from __future__ import annotations

# characters of a value that a sentence repeats
_LONGEST = 200


class InswsnError(ValueError):
    """Something the user asked for cannot be done; the message is one sentence.

    The command line prints the message and ends with exit status 2.
    """


class BuildError(RuntimeError):
    """The book cannot be built as it is; the message says where and why, at the length it needs.

    The command line prints the message and ends with exit status 1.
    """


class ParameterError(InswsnError):
    """A parameter has a value it may not have.

    Parameters
    ----------
    name : str
        The parameter.
    got : object
        What it was.
    expected : str
        What it may be, as the end of the sentence "it may be ...".
    """

    def __init__(self, name: str, got: object, expected: str) -> None:
        super().__init__(f"{name} is {_short(got)}; it may be {expected}.")
        self.name = name
        self.got = got
        self.expected = expected


def _short(value: object) -> str:
    """Return what stands for a value in a sentence: its repr, cut where nobody reads on."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of thousands of digits
        text = f"a {type(value).__name__} of very many digits"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"

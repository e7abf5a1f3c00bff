"""The errors that a user can cause; each is one sentence long."""

from __future__ import annotations

# characters of a value that a sentence repeats, of what is expected, and of a sentence
_LONGEST, _LONGEST_EXPECTED, _LONGEST_SENTENCE = 200, 600, 1000


class InswsnError(ValueError):
    """Something the user asked for cannot be done; the message is one sentence.

    The command line prints the message and ends with exit status 2.

    Examples
    --------
    >>> from pathlib import Path
    >>> from inswsn_lib.errors import InswsnError
    >>> from inswsn_lib.files import read_yaml
    >>> try:
    ...     read_yaml(Path("absent.yaml"))
    ... except InswsnError as error:
    ...     print(error)
    There is no file absent.yaml.
    """

    def __init__(self, said: str) -> None:
        # a name out of a file may be of any length, and hold what ends a line
        line = " ".join(said.splitlines())
        super().__init__(_cut(line, _LONGEST_SENTENCE))


class BuildError(RuntimeError):
    """The book cannot be built as it is; the message says where and why, at the length it needs.

    The command line prints the message and ends with exit status 1.

    Examples
    --------
    >>> from inswsn_lib.errors import BuildError
    >>> raise BuildError("chapters/printed-numbers.md: a sentence does not hold.")
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.BuildError: chapters/printed-numbers.md: a sentence does not hold.
    """


class Described(str):
    """Words that describe a value too long for a sentence, such as "of shape (2, 3)"."""

    __slots__ = ()
    __repr__ = str.__str__


class ParameterError(InswsnError):
    """A parameter has a value that is not allowed.

    Parameters
    ----------
    name : str
        The parameter.
    got : object
        What it is: the value itself, or words that describe it.
    expected : str
        What it must be, as in the sentence "gamma must be ...".

    Examples
    --------
    >>> from inswsn_lib.errors import ParameterError
    >>> raise ParameterError("gamma", -1.0, "positive")
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: gamma must be positive, not -1.0.
    """

    def __init__(self, name: str, got: object, expected: str) -> None:
        super().__init__(f"{name} must be {_cut(expected, _LONGEST_EXPECTED)}, not {_short(got)}.")
        self.name = name
        self.got = got
        self.expected = expected


def _short(value: object) -> str:
    """Return how a sentence shows a value: its repr, cut where nobody reads on."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of thousands of digits
        text = f"a {type(value).__name__} of very many digits"
    return _cut(text, _LONGEST)


def _cut(text: str, longest: int) -> str:
    return text if len(text) <= longest else f"{text[:longest]}…"

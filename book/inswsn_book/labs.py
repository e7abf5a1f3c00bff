"""Labs: charts in the page that a reader moves by sliders, drawn by ``book/_static/labs.js``.

A cell shows a still figure by `inswsn_book.show.show_figure` and the lab that takes its place
by `show_lab`. The figure stays where no script runs, and in print.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from html import escape
from typing import Any

import numpy as np
from IPython.display import display
from numpy.typing import NDArray

from inswsn_lib.errors import ParameterError

#: The labs that ``labs.js`` has.
LABS = ("gain", "kernel")


@dataclass(frozen=True)
class Slider:
    """A number that a reader of a lab may move; with `log` its places are powers of ten.

    Its ends are a whole number of steps apart, and it starts at one of its places.

    Examples
    --------
    A factor between a tenth and ten, in half decades:

    >>> from inswsn_book.labs import Slider
    >>> slider = Slider("ratio", "assumed over true", -1.0, 1.0, 0.5, start=0.0, log=True)
    >>> slider.values.round(3).tolist()
    [0.1, 0.316, 1.0, 3.162, 10.0]
    """

    name: str  # for the script
    label: str  # for the reader
    low: float
    high: float
    step: float
    start: float  # where it stands at first
    unit: str = ""
    log: bool = False
    by: str = ""  # the choice on which the unit depends, if it does
    units: Mapping[str, str] = field(default_factory=dict)  # of each option of that choice

    @property
    def places(self) -> NDArray[np.float64]:
        """Where it may stand."""
        count = round((self.high - self.low) / self.step) + 1
        return np.asarray(self.low + self.step * np.arange(count))

    @property
    def values(self) -> NDArray[np.float64]:
        """The values at its places."""
        return np.asarray(10.0**self.places if self.log else self.places)


@dataclass(frozen=True)
class Choice:
    """One of two or more things that a reader of a lab may choose, by radio buttons."""

    name: str
    label: str
    options: Mapping[str, str]  # for the script, and for the reader
    start: str


def show_lab(
    kind: str,
    *,
    title: str,
    figure: str,
    sliders: Sequence[Slider],
    choices: Sequence[Choice],
    data: Mapping[str, Any],
) -> None:
    """Show a lab in the place of a still figure of the same page, given by its label.

    The output is a hidden section that holds the numbers as JSON. ``labs.js`` fills it with
    controls, a table and charts and puts it where the picture is; without the script nothing
    changes. The title is for those who do not see the page. What the lab computes from is made of
    strings, finite numbers, lists, mappings and arrays.

    Examples
    --------
    In a notebook the lab is hidden; a plain interpreter prints what is sent to it:

    >>> from inswsn_book.labs import Choice, Slider, show_lab
    >>> show_lab(  # doctest: +ELLIPSIS
    ...     "gain",
    ...     title="A gain",
    ...     figure="fig-gain",
    ...     sliders=[Slider("gain", "g", 0.0, 1.0, 0.05, start=0.5)],
    ...     choices=[Choice("axis", "axis", {"0": "x", "1": "y"}, start="0")],
    ...     data={"period": 0.2},
    ... )
    {'text/html': '<section class="lab" ...hidden>...</section>', 'text/plain': 'A gain: ...'}
    """
    if kind not in LABS:
        raise ParameterError("kind", kind, f"one of {', '.join(LABS)}")
    content = {
        "title": title,
        "sliders": [asdict(slider) for slider in sliders],
        # pairs, since the keys of an object that look like numbers lose their order
        "choices": [asdict(c) | {"options": list(c.options.items())} for c in choices],
        "data": data,
    }
    try:
        text = json.dumps(content, allow_nan=False, separators=(",", ":"), default=_plain)
    except ValueError:
        raise ParameterError("data", "with a number that is not finite", "finite") from None
    # no "<" in a script element: it could end it, or begin a comment
    text = text.replace("<", "\\u003c")
    page = (
        f'<section class="lab" id="lab-{kind}" data-lab="{kind}" '
        f'data-figure="{escape(figure)}" hidden>'
        f'<script type="application/json">{text}</script></section>'
    )
    plain = f"{title}: the sliders of this lab need the page of the book."
    display({"text/html": page, "text/plain": plain}, raw=True)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form.")

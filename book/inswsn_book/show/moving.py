"""Figures of lessons that move: charts that follow sliders, with every number by the library.

What moves is computed here once for each place of the sliders that it depends on, and kept in
tables; the page looks them up and draws (``book/_static/moving.js``). So a page can say nothing
that the library did not. The still picture, for print and for where no script runs, is drawn from
the same tables where the sliders begin.
"""

from __future__ import annotations

import inspect
import itertools
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from html import escape
from typing import Any

import numpy as np
from IPython.display import display
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Annotation

from inswsn_book.show import show_figure
from inswsn_book.show.legible import clear_the_way
from inswsn_lib.checks import Array
from inswsn_lib.errors import ParameterError
from inswsn_lib.plotting import STROKES, figure

#: What takes the name and the content of a figure in place of the notebook, in a page
_TAKERS: list[Callable[[str, str], None]] = []
#: How a series may be drawn
STYLES = ("line", "points", "bars", "band", "circle", "handle")
_DOTS = {"points": 3, "handle": 7}  # points across, in the still picture
_HEIGHT = 3.1  # inches, of each chart in the still picture
_STEPS = 10_000  # from one end of an axis to the other, of what a page is given
_SIGNS = "".join(sign for sign in map(chr, range(33, 127)) if sign not in '"<\\`')
_BASE = len(_SIGNS) // 2
#: How the book sets numbers: a true minus, a space before per cent, and no sign of a zero
_SET = ((r"(?<![\w)])-(?=\d)", "−"), (r"(?<=\d)%", " %"), (r"\+(?=[0.]+(?![\d.]))", ""))


def shown_to(taker: Callable[[str, str], None]) -> None:
    """Have figures given to a function from now on, by name and content as JSON, and not drawn."""
    _TAKERS[:] = [taker]


@dataclass(frozen=True)
class Slider:
    """What a reader moves: its places, each with the words for it, and where it begins.

    With at most four places it is a row of buttons; one that `plays` has a button to go through
    its places by itself, as time passes.
    """

    name: str  # of the argument of what depends on it
    label: str
    values: Sequence[Any]
    start: Any  # one of the values
    form: str = "{:g}"  # of a value for the reader
    plays: bool = False

    @property
    def place(self) -> int:
        """Where it begins."""
        return list(self.values).index(self.start)


@dataclass(frozen=True)
class _Table:
    """What depends on some sliders: its values over all their places, the last slider fastest."""

    by: tuple[str, ...]
    values: list[Any]


@dataclass
class Chart:
    """One chart of a moving figure: its axes, and the series in it.

    With `equal` a metre is as long upwards as sideways.
    """

    title: str
    xlim: tuple[float, float]
    ylim: tuple[float, float]
    x: str = "time (s)"
    y: str = "error (m)"
    equal: bool = False
    series: list[tuple[str, str, str, int, _Table]] = field(default_factory=list)


class Moving:
    """A figure under construction: sliders, charts, numbers, and a sentence.

    What is given to a chart is an array, or a function of sliders by the names of its arguments,
    which is called at all their places.
    """

    def __init__(self, title: str, *sliders: Slider) -> None:
        self.title = title
        self.sliders = {slider.name: slider for slider in sliders}
        self.charts: list[Chart] = []
        self._numbers: list[tuple[str, str, _Table]] = []
        self._goals: list[tuple[str, _Table]] = []
        self._sentence = _Table((), [title])
        self._methods: set[str] = set()

    def chart(self, title: str, **axes: Any) -> Chart:
        """Add an empty chart, with the axes of a `Chart`."""
        self.charts.append(Chart(title, **axes))
        return self.charts[-1]

    def map(self, title: str, xlim: tuple[float, float], ylim: tuple[float, float]) -> Chart:
        """Add an empty chart of places in m, with equal axes."""
        return self.chart(title, x="x (m)", y="y (m)", xlim=xlim, ylim=ylim, equal=True)

    def draw(
        self, chart: Chart, method: str, label: str, what: Any, *, style: str = "line", at: int = -1
    ) -> None:
        """Draw a series: x and y, or for a band x, low and high; its label stands at a sample.

        A circle has x, y and its radius, on a chart whose axes are `equal`. A handle is one point,
        by which a reader drags the sliders that it depends on to the place whose point is nearest.
        The method gives the colour and the dashes: one of ``inswsn_lib.plotting.STROKES``.
        """
        if style not in STYLES:
            raise ParameterError("style", style, "one of " + ", ".join(STYLES))
        self._take(method)
        chart.series.append((method, label, style, at, self._table(what)))

    def number(self, method: str, label: str, what: Any) -> None:
        """Say a number, a text with its unit, beside the sliders.

        It has the key of its method's series if it is the only number of that method; "" for none.
        """
        if method:
            self._take(method)
        self._numbers.append((method, label, self._table(what)))

    def draw_each(
        self, chart: Chart, labels: Mapping[str, str], what: Callable[..., Any], **how: Any
    ) -> None:
        """Draw a series for each method of the labels: a function of the method and sliders."""
        for method, label in labels.items():
            self.draw(chart, method, label, partial(what, method), **how)

    def number_each(
        self, labels: Mapping[str, str], what: Callable[..., str]
    ) -> Callable[..., str]:
        """Say a number for each method of the labels, as `draw_each` draws.

        Returns all labels with their numbers, as a function of the sliders.
        """
        for method, label in labels.items():
            self.number(method, label, partial(what, method))
        return lambda *at: "; ".join(f"{labels[m]} {what(m, *at)}" for m in labels)

    def goal(self, text: str, reached: Callable[..., bool]) -> None:
        """Set the reader a goal; the page says when, and where, it is reached."""
        self._goals.append((text, self._table(reached)))

    def sentence(self, what: Callable[..., str]) -> None:
        """Say what the charts show, in a sentence for those who cannot see them."""
        self._sentence = self._table(what)

    def _take(self, method: str) -> None:
        if method not in STROKES:
            raise ParameterError("method", method, "one of " + ", ".join(STROKES))
        self._methods.add(method)

    def _table(self, what: Any) -> _Table:
        if not callable(what):
            return _Table((), [_typeset(what)])
        by = tuple(inspect.signature(what).parameters)
        for name in by:
            if name not in self.sliders:
                raise ParameterError("slider", name, "one of " + ", ".join(self.sliders))
        places = itertools.product(*(self.sliders[name].values for name in by))
        return _Table(by, [_typeset(what(*values)) for values in places])

    def _key(self, method: str) -> str:
        """Return the style of the series that a number of a method is of, if it is of one."""
        styles = [s[2] for chart in self.charts for s in chart.series if s[0] == method]
        alone = [number[0] for number in self._numbers].count(method) == 1
        return styles[0] if styles and alone else ""

    def _at_start(self, table: _Table) -> Any:
        index = 0
        for name in table.by:
            index = index * len(self.sliders[name].values) + self.sliders[name].place
        return table.values[index]

    def still(self) -> Figure:
        """Return the picture where the sliders begin."""
        rows, inch = len(self.charts), 1 / (_HEIGHT * len(self.charts))
        fig, axes = figure(rows, height=_HEIGHT * rows, squeeze=False, layout="none")
        # all such figures have the same margins, and a layout takes as long as the rest of drawing
        fig.subplots_adjust(0.12, 0.55 * inch, 0.96, 1 - 0.32 * inch, hspace=0.43)
        labels: list[Annotation] = []
        for chart, ax in zip(self.charts, axes[:, 0], strict=True):
            for method, label, style, at, table in chart.series:
                x, *y = map(np.asarray, self._at_start(table))
                stroke = STROKES[method]
                if style == "band":
                    ax.fill_between(x, *y, color=stroke.colour, alpha=0.2, linewidth=0)
                elif style == "bars":
                    ax.bar(x, y[0], color=stroke.colour, width=0.8 * np.diff(x).min())
                elif style == "circle":
                    for along, up, radius in zip(x, *y, strict=True):
                        ax.add_patch(Circle((along, up), radius, fill=False, color=stroke.colour))
                else:
                    dots = {"ls": "", "marker": "o", "ms": _DOTS[style]} if style in _DOTS else {}
                    dashes = (0, stroke.dashes) if stroke.dashes else "-"
                    ax.plot(x, y[0], **({"color": stroke.colour, "ls": dashes} | dots))
                if label:
                    labels += [ax.annotate(
                        label, (x[at], y[0][at]), (4, 4), textcoords="offset points",
                        color=stroke.colour, fontweight="bold",
                    )]  # fmt: skip
            ax.set(title=chart.title, xlabel=chart.x, ylabel=chart.y)
            ax.set(xlim=chart.xlim, ylim=chart.ylim)
            if chart.equal:
                ax.set_aspect("equal")
        clear_the_way(fig, labels)
        return fig

    def content(self) -> dict[str, Any]:
        """Return what the page draws, as it is written there."""
        return {
            "title": self.title,
            "sliders": [
                {"name": s.name, "label": s.label, "start": s.place, "plays": s.plays,
                 "texts": [_typeset(s.form.format(value)) for value in s.values]}
                for s in self.sliders.values()
            ],
            "strokes": {name: [*STROKES[name]] for name in sorted(self._methods)},
            "charts": [_chart(chart) for chart in self.charts],
            "numbers": [
                {"method": method, "label": label, "key": self._key(method), **vars(table)}
                for method, label, table in self._numbers
            ],
            "goals": [
                {"text": text, "by": t.by, "values": [bool(value) for value in t.values]}
                for text, t in self._goals
            ],
            "sentence": vars(self._sentence),
        }  # fmt: skip

    def show(self, name: str, caption: str) -> None:
        """Show it, with the still picture that it stands in for, as the last thing of a cell.

        The picture's alternative text is the title and the sentence.
        """
        stop = "" if self.title.endswith("?") else "."
        alt = f"{self.title}{stop} {self._at_start(self._sentence)}"
        text = json.dumps(_packed(self.content()), allow_nan=False, separators=(",", ":"))
        for take in _TAKERS:
            take(name, text)
            return
        # no "<" in a script element: it could end it, or begin a comment
        text = text.replace("<", "\\u003c")
        page = (
            f'<section class="moving" id="{escape(name)}-moving" data-figure="{escape(name)}" '
            f'hidden><script type="application/json">{text}</script></section>'
        )
        plain = f"{self.title}: it moves on the page of the book."
        display({"text/html": page, "text/plain": plain}, raw=True)
        show_figure(self.still(), name=name, caption=caption, alt=alt)


def ellipse(covariance: Any, sigmas: float = 2.0) -> Array:
    """Return a closed line (2, n) so many standard deviations about zero, by a covariance."""
    angle = np.linspace(0, 2 * np.pi, 73)
    return np.asarray(sigmas * np.linalg.cholesky(covariance) @ [np.cos(angle), np.sin(angle)])


def _typeset(what: Any) -> Any:
    if isinstance(what, str):
        for pattern, sign in _SET:
            what = re.sub(pattern, sign, what)
    return what


def _chart(chart: Chart) -> dict[str, Any]:
    series = [
        {"method": method, "label": label, "style": style, "at": at, "by": table.by,
         "values": [[np.asarray(v, float).tolist() for v in value] for value in table.values]}
        for method, label, style, at, table in chart.series
    ]  # fmt: skip
    x = {"label": chart.x, "ends": chart.xlim, "ticks": _ticks(*chart.xlim)}
    y = {"label": chart.y, "ends": chart.ylim, "ticks": _ticks(*chart.ylim)}
    return {"title": chart.title, "equal": chart.equal, "series": series, "x": x, "y": y}


def _packed(content: dict[str, Any]) -> dict[str, Any]:
    """Return content with texts for the coordinates of its series, which take a third of the room.

    No x, if it is that of the place before. ``moving.js`` reads them.
    """
    for chart in content["charts"]:
        x, y = chart["x"]["ends"], chart["y"]["ends"]
        for series in chart["series"]:
            before, packed = None, []
            if series["style"] == "circle":  # a radius is no place on an axis
                continue
            for along, *others in series["values"]:
                packed.append([None if along == before else _text(along, *x)])
                packed[-1] += [_text(values, *y) for values in others]
                before = along
            series["values"] = packed
    return content


def _text(values: Sequence[float], low: float, high: float) -> str:
    """Return numbers as a text: steps along the axis from one to the next.

    A step is doubled, less one if it leads down. Its digits begin with the lowest; the last one
    is a sign of the first half. What lies beyond an end of the axis is drawn there.
    """
    places = (np.asarray(values, dtype=float) - low) * (_STEPS / (high - low))
    steps = np.diff(places.round().clip(0, _STEPS).astype(int), prepend=0)
    signs = []
    for left in np.where(steps < 0, -2 * steps - 1, 2 * steps).tolist():
        while left >= _BASE:
            left, digit = divmod(left, _BASE)  # noqa: PLW2901
            signs.append(_SIGNS[_BASE + digit])
        signs.append(_SIGNS[left])
    return "".join(signs)


def _ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Return round numbers inside an axis and their texts, at most five steps apart."""
    least = (high - low) / 5
    power = 10.0 ** np.floor(np.log10(least))
    step = next(k * power for k in (1, 2, 5, 10) if k * power >= least * (1 - 1e-9))
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    # adding zero takes the sign off a zero
    values = [round(float(k * step), 9) + 0.0 for k in np.arange(first, last + 1)]
    return [(v, _typeset(f"{v:g}")) for v in values]

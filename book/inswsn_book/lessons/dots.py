"""Numbers to compare as dots, a row each, in place of a table."""

from __future__ import annotations

from collections.abc import Mapping

from inswsn_book.show.moving import Moving, Slider

#: A number, or a number with the ends of its interval
Number = float | tuple[float, float, float]


def show_dots(
    title: str,
    choice: str,
    rows: Mapping[str, tuple[str, Mapping[str, Number]]],
    *,
    x: str,
    xlim: tuple[float, float],
    name: str,
    caption: str,
    form: str = "{:.2f}",
    line: tuple[str, str, float] | None = None,
) -> None:
    """Show a row for each label: the method that it is drawn as, and its numbers by the choice.

    A dot beyond the chart stands at its edge; the number beside the slider is the true one. An
    upright line to compare with has a method, a label, and its place.
    """
    groups = [*next(iter(rows.values()))[1]]
    shown = Moving(title, Slider("of", choice, groups, groups[0], "{}"))
    ylim = (0.3, len(rows) + 0.7)
    chart = shown.chart(title, x=x, y="", xlim=xlim, ylim=ylim)
    if line is not None:
        method, label, place = line
        shown.draw(chart, method, label, ([place, place], [*ylim]), at=1)

    def words(number: Number) -> str:
        if isinstance(number, tuple):
            value, low, high = map(form.format, number)
            return f"{value} ({low} to {high})"
        return form.format(number)

    def add(label: str, method: str, numbers: Mapping[str, Number], at: float) -> None:
        def reach(of: str) -> tuple[list[float], list[float]]:
            number = numbers[of]
            three = number if isinstance(number, tuple) else (number,)
            return [min(value, xlim[1]) for value in three], [at] * len(three)

        if any(isinstance(number, tuple) for number in numbers.values()):
            shown.draw(chart, method, "", lambda of: [part[1:] for part in reach(of)])
        shown.draw(chart, method, label, lambda of: [p[:1] for p in reach(of)], style="points")
        shown.number(method, label, lambda of: words(numbers[of]))

    for at, (label, (method, numbers)) in enumerate(rows.items()):
        add(label, method, numbers, float(len(rows) - at))

    def said(of: str) -> str:
        each = (f"{label} {words(numbers[of])}" for label, (_, numbers) in rows.items())
        return f"{title}, {of}: " + ", ".join(each) + "."

    shown.sentence(said)
    shown.show(name=name, caption=caption, alt=" ".join(map(said, groups)))

"""Numbers to compare as dots, a row each, in place of a table."""

from __future__ import annotations

from collections.abc import Mapping

from inswsn_book.moving import Moving, Slider


def show_dots(
    title: str,
    choice: str,
    rows: Mapping[str, tuple[str, Mapping[str, float]]],
    *,
    x: str,
    xlim: tuple[float, float],
    name: str,
    caption: str,
    form: str = "{:.2f}",
) -> None:
    """Show a row for each label: the method that it is drawn as, and its numbers by the choice.

    A dot beyond the chart stands at its edge; the number beside the slider is the true one.
    """
    groups = [*next(iter(rows.values()))[1]]
    shown = Moving(title, Slider("of", choice, groups, groups[0], "{}"))
    chart = shown.chart(title, x=x, y="", xlim=xlim, ylim=(0.3, len(rows) + 0.7))

    def add(label: str, method: str, values: Mapping[str, float], at: int) -> None:
        def dot(of: str) -> tuple[list[float], list[float]]:
            return [min(values[of], xlim[1])], [float(at)]

        shown.draw(chart, method, label, dot, style="points")
        shown.number(method, label, lambda of: form.format(values[of]))

    for at, (label, (method, values)) in enumerate(rows.items()):
        add(label, method, values, len(rows) - at)

    def said(of: str) -> str:
        numbers = (f"{label} {form.format(values[of])}" for label, (_, values) in rows.items())
        return f"{title}, {of}: " + ", ".join(numbers) + "."

    shown.sentence(said)
    shown.show(name=name, caption=caption, alt=" ".join(map(said, groups)))

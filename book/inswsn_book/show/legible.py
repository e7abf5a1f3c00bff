"""What a figure is to a reader: colours of labels, texts in the way, texts beside points."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.layout_engine import PlaceHolderLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

from inswsn_lib.checks import Array

_SIDES = np.array([[0, 1], [0, -1], [1, 0], [-1, 0]])  # above, below, to the right, to the left
_THIN: dict[Any, tuple[float, float]] = {"|": (0.1, 1), "_": (1, 0.1)}  # parts of a square
_TOUCH = 1.0  # pixels by which boxes may overlap: those of texts are a little too large


def legend_of(fig: Figure) -> dict[str, str]:
    """Return the colour of each label, of what is drawn in the axes and of legends."""
    legends = [*fig.legends, *(ax.get_legend() for ax in fig.axes)]
    labelled = [
        (text.get_text(), handle)
        for legend in filter(None, legends)
        for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True)
    ]
    for ax in fig.axes:
        handles, labels = ax.get_legend_handles_labels()
        labelled += zip(labels, handles, strict=True)
    return {label: colour for label, handle in labelled if (colour := _colour(handle))}


def lay_out(fig: Figure) -> None:
    """Lay a complete figure out, once and for all: what is looked at is what is saved."""
    if not isinstance(fig.get_layout_engine(), PlaceHolderLayoutEngine):
        fig.draw_without_rendering()
        fig.set_layout_engine("none")


def texts_in_the_way(fig: Figure) -> list[str]:
    """Return the texts of a figure that lie over a marker or another text, or leave the figure."""
    lay_out(fig)
    return [text.get_text() for text in _in_the_way(fig)]


def clear_the_way(fig: Figure, labels: Sequence[Annotation]) -> None:
    """Move labels that are in the way to another side of their points, where one is free."""
    lay_out(fig)
    renderer = fig.canvas.get_renderer()  # type: ignore[attr-defined]
    bad = _in_the_way(fig)
    for label in labels:
        places = itertools.product((4, 10, 13, 18), (1, -1), (1, -1))
        while label in bad and (place := next(places, None)):
            far, up, right = place
            label.xyann = (right * min(far, 6), up * far)
            label.set(ha="left" if right > 0 else "right", va="bottom" if up > 0 else "top")
            label.update_positions(renderer)
            bad = _in_the_way(fig)


def _in_the_way(fig: Figure) -> list[Text]:
    """Return such texts of a figure that is drawn."""
    texts = _texts(fig)
    boxes = [_box(text) for text in texts]
    bad = {
        place
        for (i, one), (j, other) in itertools.combinations(enumerate(boxes), 2)
        if one.overlaps(other)
        for place in (i, j)
    }
    places, halves = _markers(fig)
    edges = fig.bbox.get_points() + _TOUCH * np.array([[-1], [1]])
    for i, box in enumerate(boxes):
        low, high = box.get_points()
        near = np.clip(places, low, high)
        over = (np.abs(places - near) < halves).all(axis=1).any()
        if over or (low < edges[0]).any() or (high > edges[1]).any():
            bad.add(i)
    return [texts[i] for i in sorted(bad)]


def place_labels(
    ax: Axes, texts: Sequence[str], points: Array, others: Array, *, mark: float = 3
) -> None:
    """Write texts beside points of a map, as near as they are clear of all that is there.

    `others` are places (rows, 2) that are not to be covered, in the units of the axes, which are
    complete by now; a line is as many places. Markers of points are `mark` points high and wide to
    each side. A text away from its point has a thin line to it.
    """
    fig = ax.figure
    assert isinstance(fig, Figure)
    fig.draw_without_rendering()
    size, points = fig.dpi / 72, np.asarray(points, dtype=float)
    marks = ax.transData.transform(points) / size
    cross = mark * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    taken = np.vstack([ax.transData.transform(np.asarray(others)) / size,
                       (marks[:, None] + cross).reshape(-1, 2)])  # fmt: skip
    angles = np.radians(np.arange(0, 360, 15))
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for text, point, middle in zip(texts, points, marks, strict=True):
        rows = text.split("\n")
        half = np.array([3.3 * max(map(len, rows)) + 1.5, 6.5 * len(rows)])
        best = (-np.inf, around[0], 0)
        for far in (11, 14, 18, 23, 29, 36, 44):
            for offset in around * (half + far - 5):  # an ellipse about the point
                away = np.abs(taken - middle - offset) - half
                clear = float(np.maximum(away, 0).max(axis=1).min())
                inside = ax.bbox.contains(*((middle + offset) * size))
                apart = np.hypot(*(marks - middle - offset).T)[marks[:, 0] != middle[0]]
                score = (min(clear, 2.0) if inside else -1) - far / 1000
                score += min([*apart, 80.0]) / 2000  # so that it is read with no other point
                if score > best[0]:
                    best = (score, offset, far)
            if best[0] > 1.9:
                break
        _, offset, far = best
        arrow = {"arrowstyle": "-", "lw": 0.6, "shrinkA": 0, "shrinkB": 3}
        ax.annotate(
            text, point, offset, textcoords="offset points", ha="center", va="center",
            arrowprops=arrow if far > 14 else None,
        )  # fmt: skip
        box = np.stack(np.meshgrid(*(np.linspace(-h, h, 5) for h in half)), axis=-1).reshape(-1, 2)
        taken = np.vstack([taken, middle + offset + box])


def label_lines(ax: Axes, **look: Any) -> None:
    """Write the label of each line of complete axes beside it, in its colour, clear of the others.

    It stands where it touches nothing, is farthest from the other lines, and within the axes.
    """
    fig = ax.figure
    assert isinstance(fig, Figure)
    fig.draw_without_rendering()
    tracks = {line: _dense(line, ax) for line in ax.lines if line.get_transform() is ax.transData}
    boxes = [_box(text) for text in _texts(fig) if text.axes is ax]
    for line, track in tracks.items():
        label = str(line.get_label())
        if label.startswith("_") or not len(track):
            continue
        text = ax.annotate(label, (0, 0), (0, 0), textcoords="offset points", ha="center",
                           va="center", color=line.get_color(), **look)  # fmt: skip
        half = np.ptp(_box(text).get_points(), axis=0) / 2 + 1
        others = np.concatenate([t for other, t in tracks.items() if other is not line] or [track])
        best = (-np.inf, track[0], np.zeros(2))
        for point in track[:: max(1, len(track) // 60)]:
            for far, side in itertools.product((3, 6, 10, 15), _SIDES):
                at = point + (shift := side * (half + far))
                inside = ((at - half > ax.bbox.min) & (at + half < ax.bbox.max)).all()
                own, clear = (_clearance(t, at, half) for t in (track, others))
                free = not any(Bbox([at - half, at + half]).overlaps(box) for box in boxes)
                score = 20 * min(own, 2) + 2 * min(clear, 14) - far / 2 + at[0] / ax.bbox.width
                score -= 9 * abs(side[0])  # beside it only where there is no other place
                if inside and free and score > best[0]:
                    best = (score, point, shift)
        _, point, shift = best
        text.xy = tuple(ax.transData.inverted().transform(point))
        text.xyann = tuple(shift * 72 / fig.dpi)
        at = point + shift
        boxes.append(Bbox([at - half, at + half]))


def least_points(fig: Figure) -> float:
    """Return the size of the smallest text of a figure, points."""
    return min((float(text.get_fontsize()) for text in _texts(fig)), default=0.0)


def _clearance(places: Array, at: Array, half: Array) -> float:
    """Return how far a box about a place is from the nearest of others, pixels."""
    return float(np.maximum(np.abs(places - at) - half, 0).max(axis=1).min())


def _dense(line: Line2D, ax: Axes) -> Array:
    """Return places along a line that are seen, at most 3 pixels apart."""
    track = ax.transData.transform(np.asarray(line.get_xydata(), dtype=float))
    track = track[np.isfinite(track).all(axis=1)]
    if len(track) > 1:
        way = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(track, axis=0).T))])
        fine = np.linspace(0, way[-1], int(way[-1] / 3) + 2)
        track = np.stack([np.interp(fine, way, part) for part in track.T], axis=1)
    return np.asarray(track[((track >= ax.bbox.min) & (track <= ax.bbox.max)).all(axis=1)])


def _colour(handle: Any) -> str:
    if isinstance(handle, Line2D):
        return to_hex(handle.get_color())
    if isinstance(handle, Patch):
        return to_hex(handle.get_facecolor())
    if isinstance(handle, tuple) and len(handle):  # bars, or a line with its whiskers
        return _colour(handle[0])
    return ""


def _texts(fig: Figure) -> list[Text]:
    """Return the texts that are drawn: of ticks those within the axes."""
    outside = set()
    for ax in fig.axes:
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            slack = 1e-9 * (high - low)
            for tick in [*axis.majorTicks, *axis.minorTicks]:
                if not (ax.axison and low - slack <= tick.get_loc() <= high + slack):
                    outside |= {tick.label1, tick.label2}
    return [
        text
        for text in fig.findobj(Text)
        if isinstance(text, Text) and text not in outside and _is_seen(text)
    ]


def _is_seen(text: Text) -> bool:
    if not (text.get_visible() and text.get_text().strip()):
        return False
    owner = text.axes
    return not isinstance(owner, Axes) or owner.get_visible()


def _box(text: Text) -> Bbox:
    found = Text.get_window_extent(text)  # without the arrow of an annotation
    return Bbox(found.get_points() + _TOUCH * np.array([[1, 1], [-1, -1]]))


def _markers(fig: Figure) -> tuple[Array, Array]:
    """Return where markers are seen and half their widths and heights, (markers, 2), pixels."""
    places, halves = [np.empty((0, 2))], [np.empty((0, 2))]
    for ax in fig.axes:
        drawn: list[tuple[Array, Any]] = [
            (
                ax.transData.transform(line.get_xydata()),
                line.get_markersize() * np.array(_THIN.get(line.get_marker(), (1, 1))),
            )
            for line in ax.lines
            if line.get_marker() not in ("", "None", None, " ") and line.get_visible()
            and line.get_transform() is ax.transData
        ]  # fmt: skip
        drawn += [
            (
                ax.transData.transform(found.get_offsets()),
                np.sqrt(found.get_sizes()).max() * np.ones(2),
            )
            for found in ax.collections
            if isinstance(found, PathCollection) and np.size(found.get_offsets())
        ]
        for at, size in drawn:
            seen = ax.bbox.padded(1)
            inside = ((at >= seen.min) & (at <= seen.max)).all(axis=1)
            places.append(np.asarray(at, dtype=float)[inside])
            halves.append(np.tile(size / 2 * fig.dpi / 72, (int(inside.sum()), 1)))
    return np.concatenate(places), np.concatenate(halves)

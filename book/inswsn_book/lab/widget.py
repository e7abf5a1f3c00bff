"""A figure that moves in JupyterLab: a widget that holds its tables and the script of the pages.

anywidget is in no environment in which pages are built: `make lab` installs it apart.
"""

from __future__ import annotations

from pathlib import Path

import anywidget
import traitlets
from IPython.display import display

_STATIC = Path(__file__).parents[2] / "_static"
_RENDER = """
const made = (name, values) => Object.assign(document.createElement(name), values);

export default {
  render({ model, el }) {
    const [id, textContent] = [`${model.get("name")}-moving`, model.get("content")];
    const root = made("section", { className: "moving", id });
    root.append(made("script", { type: "application/json", textContent }));
    window.inswsnMoving.build(root);
    el.append(root);
  },
};
"""
# the colours that the theme of the book gives by these names, and room for the mark of the focus
_STYLE = """
.moving {
  padding: 5px;
  --pst-color-primary: var(--jp-brand-color1);
  --pst-color-accent: var(--jp-brand-color1);
  --pst-color-text-muted: var(--jp-ui-font-color1);
}
"""


class MovingFigure(anywidget.AnyWidget):  # type: ignore[misc]  # the locks hold no anywidget
    """The figure: its name, and what `inswsn_book.show.moving` gives for it, as JSON."""

    _esm = (_STATIC / "moving.js").read_text(encoding="utf-8") + _RENDER
    _css = (_STATIC / "moving.css").read_text(encoding="utf-8") + _STYLE
    name = traitlets.Unicode().tag(sync=True)
    content = traitlets.Unicode().tag(sync=True)


def show(name: str, content: str) -> None:
    """Show a figure; see `inswsn_book.show.moving.shown_to`."""
    display(MovingFigure(name=name, content=content))

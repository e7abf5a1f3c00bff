"""Showing the built book from this machine, to this machine."""

from __future__ import annotations

import webbrowser
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from inswsn_lib.errors import InswsnError


class _QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing for each file."""


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a browser that goes away before its answer is no error."""


def make_server(site: Path, port: int) -> ThreadingHTTPServer:
    """Return a server of the site on the loopback address, not yet running.

    Parameters
    ----------
    site : Path
        The built book.
    port : int
        The port; 0 for any free one.

    Raises
    ------
    InswsnError
        If there is no built book or the port is taken.
    """
    if not (site / "index.html").is_file():
        raise InswsnError(f"There is no built book in {site}; build it first: make book.")
    try:
        return _Server(("127.0.0.1", port), partial(_QuietHandler, directory=str(site)))
    except OSError as error:
        raise InswsnError(
            f"Port {port} cannot be used ({error.strerror}); "
            "name another one: make serve PORT=8001."
        ) from None


def address(server: ThreadingHTTPServer) -> str:
    """Return the address of a server's front page."""
    return f"http://127.0.0.1:{server.server_address[1]}/"


def open_in_browser(url: str) -> bool:
    """Open a page in the reader's browser; return whether there was one to open it."""
    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False

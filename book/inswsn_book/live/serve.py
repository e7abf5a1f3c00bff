"""The book on the reader's own machine: every cell runs, in kernels of that machine.

It listens on 127.0.0.1 alone, and what comes has to name that host: a page elsewhere whose name is
made to lead here is refused. To run code takes a token as well, which is printed once; no page of
another origin is answered. What runs has all the rights of who started this.
"""

from __future__ import annotations

import asyncio
import json
import re
import secrets
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from errno import EADDRINUSE
from functools import cache
from hmac import compare_digest
from typing import Any, ClassVar

import click
from pydantic import BaseModel, ValidationError
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.iostream import StreamClosedError
from tornado.netutil import bind_sockets
from tornado.web import (
    Application,
    HTTPError,
    RequestHandler,
    StaticFileHandler,
    stream_request_body,
)

from inswsn_book.cli import run_command
from inswsn_book.live.about import about_chapter
from inswsn_book.live.html import SCRIPTS, policy_of, with_cells
from inswsn_book.live.kernels import BusyError, Kernel, Kernels
from inswsn_book.project import ROOT_VARIABLE, Chapter, Project, find_root
from inswsn_book.runs import Request, environment_of
from inswsn_lib.errors import InswsnError

_HOST = "127.0.0.1"
_LARGEST = 2_000_000  # bytes of a request
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class RefusedError(HTTPError):
    """A request that is not answered, with the sentence that says why."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(status)
        self.sentence = sentence


class Served:
    """What is served: the pages of the book, of which some are chapters, and their kernels."""

    def __init__(self, project: Project, port: int, token: str) -> None:
        self.site = project.site
        self.hosts = (f"{_HOST}:{port}", f"localhost:{port}")
        self.address = f"http://{_HOST}:{port}/#token={token}"
        self.token = token
        self.kernels = Kernels()
        self._project = project
        self._chapters = {f"chapters/{c.name}.html": c for c in project.chapters()}
        self.about = cache(self._about)

    def chapter(self, page: str) -> Chapter:
        """Return the chapter that a page is, by its path below the site."""
        if page not in self._chapters:
            raise RefusedError(400, "There is no chapter of that address.")
        return self._chapters[page]

    def _about(self, page: str) -> dict[str, Any]:
        """Return what a page is told: one without cells keeps the token for those it links to."""
        if page not in self._chapters:
            return {"kernel": True, "cells": [], "parameters": []}
        return about_chapter(self._chapters[page])

    def environment(self, chapter: Chapter) -> dict[str, str]:
        """Return the environment in which a chapter is executed for the book."""
        own = {ROOT_VARIABLE: str(self._project.root)}
        return environment_of(self._project, Request(chapter.id)) | own


class Guarded(RequestHandler):
    """Answers with all headers that make a browser careful, and only who came by the address."""

    methods: ClassVar[tuple[str, ...]]

    @property
    def served(self) -> Served:
        """What is served."""
        served: Served = self.settings["served"]
        return served

    def set_default_headers(self) -> None:
        """Set the headers of every answer, of a refusal, too."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)
        self.set_policy("")

    def set_policy(self, html: str) -> None:
        """Set the policy of a page."""
        self.set_header("Content-Security-Policy", f"{policy_of(html)}; frame-ancestors 'none'")

    def prepare(self) -> None:
        """Refuse another host, by which a page elsewhere may have got here, or method."""
        if self.request.headers.get("Host") not in self.served.hosts:
            raise RefusedError(403, f"This is {self.served.hosts[0]}, and no other host.")
        if self.request.method not in self.methods:
            raise RefusedError(403, f"The method here is {' or '.join(self.methods)}.")
        if "%00" in self.request.path:
            raise RefusedError(404, "There is no such file.")

    def write_error(self, status_code: int, **details: Any) -> None:
        """Say in one sentence why there is nothing."""
        error = details.get("exc_info", (None, None))[1]
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(getattr(error, "sentence", f"{self._reason}.") + "\n")


class File(Guarded, StaticFileHandler):
    """A file of the site as it is; the handler of tornado refuses paths and links out of it."""

    methods = ("GET", "HEAD")

    def set_extra_headers(self, path: str) -> None:
        """Have the browser ask each time whether it is still the same."""
        self.set_header("Cache-Control", "no-cache")


class Page(Guarded):
    """A page of the site, with the script that runs its cells, and a policy of its own."""

    methods = ("GET", "HEAD")

    def get(self, path: str) -> None:
        """Answer with a page; a folder is its index."""
        name = path if path.endswith(".html") else f"{path}index.html"
        page = with_cells(self._read(name), "../" * name.count("/"), self.served.about(name))
        self.set_policy(page)
        self.set_header("Cache-Control", "no-cache")
        self.finish(page)

    head = get

    def _read(self, name: str) -> str:
        site = self.served.site.resolve()
        try:
            place = (site / name).resolve()
            if not place.is_relative_to(site):
                raise RefusedError(403, "That is not in the book.")
            return place.read_text(encoding="utf-8")
        except OSError:
            raise RefusedError(404, "There is no such page.") from None


class Asked(BaseModel):
    """What a page asks for: see `inswsn_book.live.cells.answer`."""

    page: str
    sources: list[str] = []
    runs: list[bool] = []
    wanted: list[int] = []
    below: bool = False


@stream_request_body
class Posted(Guarded):
    """What only a page of this origin may ask for, with the token. Nothing else of it is read."""

    methods = ("POST",)

    def prepare(self) -> None:
        """Refuse whoever is not such a page before the body is read."""
        super().prepare()
        headers, host = self.request.headers, self.request.headers["Host"]
        if headers.get("Origin", f"http://{host}") != f"http://{host}":
            raise RefusedError(403, "A page of another origin is not answered.")
        given, own = headers.get("Authorization", ""), f"token {self.served.token}"
        if not compare_digest(given.encode(), own.encode()):
            raise RefusedError(
                403, "Open the address that make serve LIVE=1 has printed: it holds the token."
            )
        if headers.get("Content-Type", "").partition(";")[0].strip() != "application/json":
            raise RefusedError(403, "What is asked for is said as application/json.")
        length = headers.get("Content-Length", "")
        if length.isdecimal() and int(length[:20]) > _LARGEST:
            raise RefusedError(413, f"At most {_LARGEST} bytes are read.")
        self._body = b""

    def data_received(self, chunk: bytes) -> None:
        """Take a piece of the body, whose length need not have been said."""
        self._body += chunk
        if len(self._body) > _LARGEST:
            raise RefusedError(413, f"At most {_LARGEST} bytes are read.")

    def asked(self) -> Asked:
        """Return what is asked for, with the path of the page below the site."""
        try:
            asked = Asked.model_validate_json(self._body)
        except ValidationError:
            raise RefusedError(400, "That is nothing that a page asks for.") from None
        return asked.model_copy(update={"page": asked.page.removeprefix("/")})


class Run(Posted):
    """Runs cells, and says what comes of them as it comes, a line of JSON each."""

    _kernel: Kernel | None = None

    async def post(self) -> None:
        """Run what is asked for."""
        asked = self.asked()
        chapter = self.served.chapter(asked.page)
        cells = len(self.served.about(asked.page)["cells"])
        if not len(asked.sources) == len(asked.runs) == cells or not (
            asked.wanted and all(0 <= cell < cells for cell in asked.wanted)
        ):
            raise RefusedError(400, "Those are not the cells of the page: load it anew.")
        environment = self.served.environment(chapter)
        self.set_header("Content-Type", "application/x-ndjson")
        self.set_header("Cache-Control", "no-store")
        try:
            async with self.served.kernels.taken(asked.page, environment) as self._kernel:
                async for said in self._kernel.answer(asked.model_dump()):
                    self.write(json.dumps(said) + "\n")
                    await self.flush()
        except BusyError as error:
            raise RefusedError(409, str(error)) from None
        except StreamClosedError:  # nobody listens any more
            pass
        finally:
            self._kernel = None

    def on_connection_close(self) -> None:
        """Stop what nobody waits for: the page was closed, or loaded anew."""
        super().on_connection_close()
        if self._kernel is not None:
            IOLoop.current().add_callback(self._kernel.stop)


class Stop(Posted):
    """Interrupts what a page runs."""

    async def post(self) -> None:
        """Interrupt it."""
        await self.served.kernels.stop(self.asked().page)
        self.set_status(204)


def listen(project: Project, port: int) -> tuple[Served, HTTPServer]:
    """Listen on a port of 127.0.0.1, or on any free one for 0; return what is served, and by what.

    Raises
    ------
    InswsnError
        If there is no built book, or the port is taken.
    """
    if not (project.site / "index.html").is_file():
        raise InswsnError(f"There is no built book in {project.site}; build it first: make book.")
    try:
        sockets = bind_sockets(port, _HOST, socket.AF_INET)
    except OSError as error:
        if error.errno != EADDRINUSE:
            raise
        raise InswsnError(
            f"Port {port} is taken; choose another one, such as PORT={port + 1}."
        ) from None
    served = Served(project, sockets[0].getsockname()[1], secrets.token_urlsafe())
    site = {"path": str(served.site)}
    routes = [("/live/run", Run), ("/live/stop", Stop), (r"/(.*\.html|.*/|)", Page)]
    own = "|".join(re.escape(path.name) for path in SCRIPTS.iterdir())
    files = [(f"/_static/({own})", File, {"path": str(SCRIPTS)}), ("/(.*)", File, site)]
    application = Application([*routes, *files], served=served)
    server = HTTPServer(application)
    server.add_sockets(sockets)
    return served, server


async def serve(
    project: Project, port: int, stop: asyncio.Event, tell: Callable[[Served], None]
) -> None:
    """Serve the book until there is a reason to stop, and tell what is served once it is."""
    served, server = listen(project, port)
    tell(served)
    try:
        await stop.wait()
    finally:
        server.stop()
        await served.kernels.end()
        await server.close_all_connections()


async def serve_until_told(project: Project, port: int) -> None:
    """Serve the book until this process is told to stop."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        # nohup has it ignored, and that is meant; Windows has no such handlers
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            with suppress(NotImplementedError):
                loop.add_signal_handler(number, stop.set)
    await serve(project, port, stop, _say)


def _say(served: Served) -> None:
    click.echo(f"The book is at {served.address} (stop with Ctrl-C)")
    click.echo("Whoever has this address can run code as you: keep it to yourself.")


@click.command()
@click.option("--port", type=click.IntRange(1, 65535), default=8000, show_default=True)
def main(port: int) -> None:
    """Serve the built book, whose cells run on this machine."""
    asyncio.run(serve_until_told(Project(find_root()), port))


if __name__ == "__main__":
    run_command(main)

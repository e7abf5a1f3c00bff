"""The book on the reader's own machine: what runs there, and who is refused."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any

import pytest
from inswsn_book.live.html import policy_of, with_cells, with_policy
from inswsn_book.live.kernels import BusyError, Kernels
from inswsn_book.live.said import MOST, Said
from inswsn_book.live.serve import Served
from inswsn_book.project import Project
from serving import serving

CHAPTER = """\
---
jupytext: {text_representation: {extension: .md, format_name: myst}}
kernelspec: {display_name: Python 3, language: python, name: python3}
---

# A small lesson

```{code-cell} ipython3
:tags: [parameters]

# What the number is multiplied by.
scale: float = 2.0  # 1; in (0, 100]
# How often.
times: int = 3  # times; in (0, inf)
# A word.
word: str = "a"  # 1; one of a, b
```

```{code-cell} ipython3
number = 21
```

```{code-cell} ipython3
:tags: [remove-cell]

twice = scale * number
```

```{code-cell} ipython3
print(twice)
```
"""
#: The cells, as a page asks for them
SOURCES = ["scale = 2.0", "number = 21", "twice = scale * number", "print(twice)\nnumber"]
PAGE = "chapters/00-small.html"
HTML = """<!DOCTYPE html><html lang="en"><head><title>x</title><script>let a = "é";</script></head>
<body><button onclick="window.print()">x</button><script src="x.js"></script>
<script type="application/json">{"b": 1}</script></body></html>
"""
SECRET = "not for everybody"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A project of one chapter, with a site beside which there is a secret."""
    root = tmp_path_factory.mktemp("small")
    site = root / "_build" / "html"
    for folder in (root / "chapters", root / "data", site / "chapters"):
        folder.mkdir(parents=True)
    for name in ("_config.yml", "environment.lock"):
        (root / name).touch()
    (root / "chapters" / "00-small.md").write_text(CHAPTER, encoding="utf-8")
    for name in ("index.html", PAGE):
        (site / name).write_text(HTML, encoding="utf-8")
    (site / "x.js").write_text("1;", encoding="utf-8")
    for name in ("secret.txt", "secret.html"):
        (site.parent / name).write_text(SECRET, encoding="utf-8")
        (site / f"link-{name}").symlink_to(site.parent / name)
    return Project(root)


@pytest.fixture(scope="module")
def served(small: Project) -> Iterator[Served]:
    """The small project as it is served."""
    with serving(small) as served:
        yield served


@dataclass
class Answer:
    """What a server answers: status, headers, and body."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.body.splitlines()]


def port_of(served: Served) -> int:
    return int(served.hosts[0].partition(":")[2])


def ask(
    served: Served, path: str, body: Any = None, method: str | None = None, **headers: str | None
) -> Answer:
    """Ask as a page of the book does, but for some headers; None leaves one away."""
    own = {"Authorization": f"token {served.token}", "Content-Type": "application/json"}
    own |= {"Origin": f"http://{served.hosts[0]}", "Host": served.hosts[0]}
    given = own | {name.replace("_", "-"): value for name, value in headers.items()}
    connection = HTTPConnection("127.0.0.1", port_of(served), timeout=600)
    content = body if isinstance(body, bytes | None) else json.dumps(body).encode()
    connection.putrequest(method or ("GET" if body is None else "POST"), path, skip_host=True)
    for name, value in given.items():
        if value is not None:
            connection.putheader(name, value)
    if content is not None and "Content-Length" not in given:
        connection.putheader("Content-Length", str(len(content)))
    connection.endheaders(content)
    found: HTTPResponse = connection.getresponse()
    answer = Answer(found.status, dict(found.getheaders()), found.read())
    connection.close()
    return answer


def request_of(wanted: list[int], sources: list[str] = SOURCES, **more: Any) -> dict[str, Any]:
    runs = [True] * len(sources)
    return {"page": f"/{PAGE}", "sources": sources, "runs": runs, "wanted": wanted, **more}


# What is served ----------------------------------------------------------------------------------


def test_a_page_has_its_cells_and_what_they_may_be_set_to(served: Served) -> None:
    page = ask(served, f"/{PAGE}").body.decode()
    found = re.search(r'<script type="application/json" id="live">(.*?)</script>', page)
    assert found is not None
    about = json.loads(found[1])
    source = "twice = scale * number"
    needed = [[], [], [0, 1], [0, 1, 2]]
    runs = [{"needs": "", "seconds": 0, "before": before} for before in needed]
    assert about["cells"] == [*runs[:2], runs[2] | {"source": source}, runs[3]]
    assert about["kernel"] is True
    assert about["parameters"] == [
        {"name": "scale", "value": 2.0, "low": 0, "above": True, "high": 100, "below": False,
         "whole": False, "meaning": "What the number is multiplied by."},
        {"name": "times", "value": 3, "low": 1, "above": False, "high": None, "below": False,
         "whole": True, "meaning": "How often."},
    ]  # fmt: skip
    assert '<script src="../_static/live.js"></script>' in page
    front = ask(served, "/").body.decode()
    assert '"cells": []' in front
    assert '<script src="_static/live.js"></script>' in front


def test_a_page_that_has_cells_is_told_anew() -> None:
    first = with_cells(HTML, "../", {"cells": [1], "said": "</script>\\1"})
    second = with_cells(first, "../", {"cells": [2]})
    assert with_cells(second, "../", {"cells": [1], "said": "</script>\\1"}) == first
    assert second == with_cells(HTML, "../", {"cells": [2]})
    assert first.count("live.js") == first.count("live.css") == first.count('id="live"') == 1


def test_a_policy_lets_run_what_stands_in_the_page_alone() -> None:
    policy = dict(part.split(" ", 1) for part in policy_of(HTML).split("; "))
    # openssl dgst -sha256 -binary | base64, of each text
    script = "'sha256-bRpuFRoYVKjvn/GA0B4PGwNkBZ9x/rIEtQahq9wjZ24='"
    handler = "'sha256-MguIPR6qNR8D3B+eAlK+bIRTZe8t3wkOY4B/56Me9FU='"
    own = "'self' 'wasm-unsafe-eval'"
    assert policy["script-src"] == f"{own} {script} 'unsafe-hashes' {handler}"
    assert policy["default-src"] == policy["object-src"] == policy["base-uri"] == "'none'"
    assert policy["connect-src"] == policy["worker-src"] == "'self'"
    assert f"script-src {own} 'unsafe-hashes' {handler};" in policy_of("")
    html = with_policy(with_policy(HTML, "first"), "second")
    assert re.findall(r'Policy" content="(\w+)"', html) == ["second"]


@pytest.mark.parametrize("path", ["/", f"/{PAGE}", "/x.js", "/none.html", "/none", "/live/run"])
def test_all_answers_are_told_to_be_careful_with(served: Served, path: str) -> None:
    headers = ask(served, path).headers
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cross-Origin-Opener-Policy"] == "same-origin"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert not [name for name in headers if name.startswith("Access-Control")]


@pytest.mark.parametrize("name", ["secret.txt", "secret.html"])
@pytest.mark.parametrize("way", [
    "/../", "/%2e%2e/", "/..%2f", "/chapters/../../", "/chapters/%2e%2e%2f%2e%2e%2f", "/link-",
    "//../", "/..%5c", "/..\\", "/%00/../../", "/.%00./", "/%252e%252e/",
])  # fmt: skip
def test_nothing_outside_the_site_is_served(served: Served, way: str, name: str) -> None:
    answer = ask(served, way + name)
    assert answer.status in (400, 403, 404)
    assert SECRET.encode() not in answer.body


def test_an_absolute_path_is_one_below_the_site(served: Served, small: Project) -> None:
    answer = ask(served, f"/{small.build / 'secret.html'}")
    assert answer.status in (403, 404)
    assert SECRET.encode() not in answer.body


# Who is refused ----------------------------------------------------------------------------------

EVIL = "http://evil.example"
REFUSED: list[tuple[int, dict[str, Any]]] = [
    (403, {"Authorization": None}),
    (403, {"Authorization": "token "}),
    (403, {"Authorization": "token null"}),
    (403, {"Authorization": "Bearer of another server"}),
    (403, {"Authorization": "token é"}),
    (403, {"Origin": EVIL}),
    (403, {"Origin": "null"}),
    (403, {"Origin": "http://127.0.0.1:1"}),
    (403, {"Host": "evil.example", "Origin": EVIL}),
    (403, {"Host": "evil.example", "Origin": None}),
    (403, {"Host": "127.0.0.1", "Origin": None}),
    (403, {"Content_Type": "text/plain"}),
    (403, {"Content_Type": None}),
    (403, {"method": "PUT"}),
    (403, {"method": "GET"}),
    (403, {"method": "OPTIONS"}),
    (413, {"body": b"", "Content_Length": "2000001"}),
    (400, {"body": b"{"}),
    (400, {"body": {"page": PAGE, "sources": "number"}}),
    (400, {"body": request_of([9])}),
    (400, {"body": request_of([])}),
    (400, {"body": request_of([0], SOURCES[:3])}),
    (400, {"body": request_of([0]) | {"page": "/index.html"}}),
    (400, {"body": request_of([0]) | {"page": "/../secret.html"}}),
]


@pytest.mark.parametrize(("status", "how"), REFUSED)
def test_whoever_is_not_such_a_page_runs_nothing(
    served: Served, status: int, how: dict[str, Any]
) -> None:
    answer = ask(served, "/live/run", **({"body": request_of([0])} | how))
    assert answer.status == status
    assert re.fullmatch(r"[A-Z].+\.\n", answer.body.decode())
    assert served.kernels.pages == []


def test_the_token_of_another_server_runs_nothing(served: Served, small: Project) -> None:
    with serving(small) as other:
        assert other.token != served.token
        authorization = f"token {other.token}"
        for path in ("/live/run", "/live/stop"):
            answer = ask(served, path, request_of([0]), Authorization=authorization)
            assert answer.status == 403
            assert b"make serve LIVE=1" in answer.body
    assert served.kernels.pages == []


def test_a_body_whose_length_is_not_said_has_an_end(served: Served) -> None:
    with socket.create_connection(("127.0.0.1", port_of(served)), 10) as connection:
        head = f"POST /live/run HTTP/1.1\r\nHost: {served.hosts[0]}\r\n"
        head += f"Authorization: token {served.token}\r\nContent-Type: application/json\r\n"
        connection.sendall(f"{head}Transfer-Encoding: chunked\r\n\r\n".encode())
        chunks = (b"10000\r\n" + b" " * 65536 + b"\r\n" for _ in range(1000))
        with pytest.raises(OSError, match=r"reset|pipe"):
            connection.sendall(b"".join(chunks))


@pytest.mark.parametrize("path", ["/", f"/{PAGE}", "/x.js"])
def test_a_name_that_is_made_to_lead_here_gets_no_page(served: Served, path: str) -> None:
    answer = ask(served, path, Host=f"evil.example:{port_of(served)}")
    assert answer.status == 403
    assert b"<html" not in answer.body
    assert ask(served, path, Host=served.hosts[1]).status == 200


def test_it_listens_on_loopback_alone(served: Served) -> None:
    own = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    own += [line.split() for line in Path("/proc/net/tcp6").read_text().splitlines()[1:]]
    port = f":{port_of(served):04X}"
    assert [at[1] for at in own if at[1].endswith(port) and at[3] == "0A"] == [f"0100007F{port}"]


# What runs ---------------------------------------------------------------------------------------


def run(served: Served, wanted: list[int], sources: list[str] = SOURCES, **more: Any) -> Any:
    answer = ask(served, "/live/run", request_of(wanted, sources, **more))
    assert answer.status == 200, answer.body
    assert answer.headers["Content-Type"] == "application/x-ndjson"
    return answer.lines


def test_cells_run_in_the_kernel_of_their_page(served: Served, small: Project) -> None:
    """All of it in one test: a kernel takes a second or more to start."""
    lines = run(served, [3])
    assert [line["cell"] for line in lines] == [0, 0, 1, 1, 2, 2, 3, 3]
    assert lines[-2] == {"cell": 3, "starts": 4, "of": 4}
    assert lines[-1]["text"] == "42.0\n21\n"
    assert lines[-1]["error"] == lines[-1]["needs"] == ""

    # what has run does not run again, and what needs what changed does
    assert [line["cell"] for line in run(served, [3])] == [3, 3]
    changed = ["scale = 3.0", *SOURCES[1:]]
    assert [line["cell"] for line in run(served, [0], changed, below=True)] == [0, 0, 2, 2, 3, 3]

    # an error keeps from running what needs the cell
    *_, last = run(served, [1, 3], ["", "number = 1 / 0", *SOURCES[2:]])
    assert last["cell"] == 1
    assert last["error"].startswith("Traceback (most recent call last)")
    assert last["error"].endswith("ZeroDivisionError: division by zero\n")
    assert "\x1b" not in last["error"]

    # nothing of the checkout is changed, and it is found
    where = """import os, sys
from pathlib import Path
from inswsn_book.project import find_root, results_folder
assert Path(os.environ["INSWSN_RESULTS"]) == results_folder(find_root())
assert not results_folder(find_root()).is_relative_to(find_root())
print(find_root(), "TOKEN" in str(os.environ))"""
    (*_, last) = run(served, [0], [where, "", "", ""])
    assert last["text"] == f"{small.root} False\n"

    # a cell that records may run again, and says what is untrue
    records = """from inswsn_book.record import ChapterRecord
record = ChapterRecord("00", {"scale": 2.0, "times": 3, "word": "a"})
for value in (1, 2):
    record.note("length", value, "m", "The length, as it was said.")
    record.holds("It is so.", value == 2)
print(record.results()["length"].value, record.results().sentences)"""
    (*_, last) = run(served, [0], [records, "", "", ""])
    assert last["error"] + last["text"] == "No longer true: It is so.\n2.0 {'It is so.': True}\n"

    # a figure that moves is handed over, and its still picture is left out
    figure = """from IPython.display import display, HTML
svg = "<svg xmlns='http://www.w3.org/2000/svg'></svg>"
display({"text/html": '<section class="moving" id="fig-a-moving" data-figure="fig-a" hidden>'
         '<script type="application/json">{"title":"\\\\u003cb"}</script></section>',
         "text/plain": "It moves."}, raw=True)
for about in ({"name": "fig-a"}, {"name": "fig-b", "alt": "A line."}):
    display({"image/svg+xml": svg, "text/plain": "alt"}, metadata={"inswsn": about}, raw=True)
HTML("<b>bold</b>")"""
    (*_, last) = run(served, [0], [figure, "", "", ""])
    assert last["figures"] == [["fig-a", '{"title":"\\u003cb"}']]
    ((kind, drawn, alt),) = last["images"]
    assert (kind, alt) == ("image/svg+xml", "A line.")
    assert base64.b64decode(drawn).startswith(b"<svg xmlns=")
    assert last["text"] == "<IPython.core.display.HTML object>\n"

    # a run that lasts is stopped; meanwhile its page runs nothing else
    flag = small.root / "flag"
    lasts = f"open({str(flag)!r}, 'w').close()\nimport time\ntime.sleep(600)"
    stopped: list[Any] = []
    thread = threading.Thread(target=lambda: stopped.extend(run(served, [0], [lasts, "", "", ""])))
    thread.start()
    wait_for(flag.exists)
    refused = ask(served, "/live/run", request_of([1]))
    assert (refused.status, refused.body) == (
        409, b"This page runs code already: wait for it, or stop it.\n",
    )  # fmt: skip
    assert ask(served, "/live/stop", {"page": f"/{PAGE}"}).status == 204
    thread.join(600)
    assert re.search(r"KeyboardInterrupt:?\n$", stopped[-1]["error"])

    # what a page that is left runs is stopped, and the kernel is there for the next
    flag.unlink()
    connection = HTTPConnection("127.0.0.1", port_of(served))
    body = json.dumps(request_of([0], [lasts, "", "", ""]))
    headers = {"Authorization": f"token {served.token}", "Content-Type": "application/json"}
    connection.request("POST", "/live/run", body, headers)
    wait_for(flag.exists)
    connection.close()
    wait_for(lambda: ask(served, "/live/run", request_of([1])).status == 200)
    assert run(served, [3], ["", "", "", "print(twice)"])[-1]["text"] == "63.0\n"

    # one that is gone is told, and another one starts
    *_, last = run(served, [0], ["import os; os._exit(1)", "", "", ""])
    assert "The kernel has ended" in last["error"]
    assert served.kernels.pages == []


def wait_for(held: Any, seconds: float = 600) -> None:
    end = time.monotonic() + seconds
    while not held():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_the_least_recently_used_kernel_of_five_is_ended() -> None:
    """None of them has a process yet: it is started by the first cell."""
    kernels = Kernels()

    async def takes() -> None:
        for page in "abcdab":
            async with kernels.taken(page, {}):
                pass
        assert kernels.pages == [*"cdab"]
        async with kernels.taken("c", {}), kernels.taken("e", {}):
            assert kernels.pages == [*"abce"]
            with pytest.raises(BusyError, match="This page"):
                await kernels.taken("e", {}).__aenter__()
            async with kernels.taken("a", {}), kernels.taken("b", {}):
                with pytest.raises(BusyError, match="4 pages"):
                    await kernels.taken("f", {}).__aenter__()
        await kernels.end()
        assert kernels.pages == []

    # in a thread of its own: in this one the browser of other tests may have a loop that runs
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, takes()).result()


def test_what_is_printed_has_an_end() -> None:
    said = Said()
    for _ in range(30):
        text = {"text": "x" * 100_000}
        said.take({"header": {"msg_type": "stream"}, "content": text})
    assert len(said.text) < MOST + 100
    assert said.text.endswith("left out.\n")


# The command -------------------------------------------------------------------------------------

COMMAND = [sys.executable, "-I", "-X", "utf8", "-m", "inswsn_book.live.serve", "--port"]


def free_port() -> int:
    with socket.socket() as chosen:
        chosen.bind(("127.0.0.1", 0))
        return int(chosen.getsockname()[1])


@pytest.mark.usefixtures("as_in_a_terminal")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_its_end_is_that_of_its_kernels(small: Project, number: signal.Signals) -> None:
    port = free_port()
    with subprocess.Popen(
        [*COMMAND, str(port)], cwd=small.root, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"INSWSN_ROOT": str(small.root)},
    ) as process:  # fmt: skip
        assert process.stdout is not None
        address = process.stdout.readline()
        found = re.search(rf"http://127\.0\.0\.1:{port}/#token=([\w-]{{40,}}) ", address)
        assert found is not None, address
        served = _Elsewhere((f"127.0.0.1:{port}", ""), found[1])
        source = "import os, subprocess; print(os.getpid(), os.getcwd())\n"
        source += "print(subprocess.Popen(['sleep', '600']).pid)"
        kernel, folder, child = run(served, [0], [source, "", "", ""])[-1]["text"].split()
        assert Path(folder).is_dir()
        process.send_signal(number)
        assert process.wait(600) == 0
    for each in (kernel, child):
        wait_for(lambda each=each: not is_alive(int(each)))
    assert not Path(folder).exists()


@dataclass
class _Elsewhere:
    hosts: tuple[str, str]
    token: str
    kernels: list[Any] = field(default_factory=list)


def is_alive(number: int) -> bool:
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_a_port_that_is_taken_is_one_sentence(small: Project) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        done = subprocess.run(
            [*COMMAND, str(port)], cwd=small.root, capture_output=True, text=True, check=False
        )
    assert done.returncode == 2
    assert (
        done.stderr
        == f"inswsn: Port {port} is taken; choose another one, such as PORT={port + 1}.\n"
    )


def test_without_a_book_it_says_how_to_build_one(tmp_path: Path) -> None:
    from inswsn_book.live.serve import listen

    from inswsn_lib.errors import InswsnError

    with pytest.raises(InswsnError, match="make book"):
        listen(Project(tmp_path), 0)

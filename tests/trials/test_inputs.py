"""Command lines and files, valid, mutated and made up: each ends with its result or a sentence.

What a command computes is left out, at one place: `computed`.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import re
import resource
import shutil
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
import pytest
from inswsn_book.judge import review
from inswsn_book.judge.claims import read_verdicts
from inswsn_book.judge.ledger import load_claims
from inswsn_book.judge.verdicts import verdicts
from inswsn_book.make import chapters, sweep
from inswsn_book.make.chapters import gather_parameters
from inswsn_book.make.cli import cli, run_command
from inswsn_book.make.pages import read_json
from inswsn_book.record.notebooks import read_source
from inswsn_book.record.parameters import (
    FILE_RULE,
    REGRESSOR_RULE,
    Parameter,
    Schema,
    chapter_schema,
    read_schema,
)
from inswsn_book.record.project import Chapter, Project
from inswsn_book.record.results import read_results
from inswsn_book.run import compare, store as runs

import inswsn_lib as iw
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_yaml
from inswsn_lib.navigation import read_trials
from inswsn_lib.papers import interval, read_numbers, read_table
from inswsn_lib.scenario import from_settings, load_scenario
from inswsn_lib.simulation import Scene

#: Texts that break readers: numbers, words and signs of YAML, of Python, and of nobody
ODD = [
    *("", " ", "0", "-0", "1", "-1", "010", "0o7", "0x1F", "1_000", "1:30", "1e3", "1E-400"),
    *("1e400", "nan", "NaN", ".nan", "inf", "-inf", ".inf", "Infinity", "true", "True", "tRue"),
    *("yes", "no", "on", "null", "~", "None", "½", "٣", "１２", "é", "𝄞", "\u202e", "\ufeff"),
    *("\x85", "\u2028", "\x07", "-", "--", "=", "a=b", ",", "1,2", "[1, 2]", "{a: 1}", "!!int 3"),
    *("! 3", "*a", "&a", "<<", "#", "'", '"', "\\", "|", ">", "%s", "{}", "{0}", "{{ 1 }}", "$(a)"),
    *("/", ".", "..", "~nobody/x", "\n", "\t", "\r\n", "x" * 5_000, "9" * 5_000, "1" * 400),
    *("-" * 3_000, "[" * 3_000, "x" * 255, "2012-02-31", "1.5.2", "+5", "5.", ".5", "1e", "-01"),
    *("0.1e1.5", "01.50", "1 2", "&a [*a]", "1e-999999", "? a", "- -", "data", "a.b:", ":"),
    *("!!int ''", "!!timestamp x", "!!bool x", "!!binary x", "!!python/object:os.x {}"),
    *("examples/ins-wsn.csv", "sklearn.linear_model:Ridge", "json:loads", "builtins:exit"),
]
#: What is no UTF-8, or begins a file
BYTES = [b"\xff", b"\xfe\xff", b"\x00", b"\xc3\x28", b"\xed\xa0\x80", b"\xef\xbb\xbf", b"\x1b[31m"]
#: Short texts that stand for 10^9 letters, or hold themselves
BOMBS = [
    "a: &a [x,x,x,x,x,x,x,x,x]\n"
    + "".join(f"{b}: &{b} [{','.join(9 * [f'*{a}'])}]\n" for a, b in pairwise("abcdefgh")),
    *("&a [*a]", "a: &a {b: *a}"),
]
SCALARS = [*range(-3, 12), 0.1, -2.5, 1e300, 10**400, True, False, None, float("nan"), float("inf")]


class Inputs:
    """Odd values and texts, from a seed."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def few(self, most: int = 4) -> int:
        return min(int(self.rng.expovariate(0.7)), most)

    def text(self) -> str:
        """Return an odd text, a number, or signs from anywhere in Unicode."""
        rng, kind = self.rng, self.rng.random()
        if kind < 0.5:
            return rng.choice(ODD)
        if kind < 0.8:
            return str(
                rng.choice([rng.randint(-9, 400), rng.gauss(0, 9), 10 ** rng.uniform(-9, 9)])
            )
        places = (rng.choice([(33, 126), (161, 0xD7FF), (0x10000, 0x10FFF)]) for _ in range(6))
        return "".join(chr(rng.randint(*place)) for place in places)[: rng.randint(1, 6)]

    def value(self, depth: int = 3) -> Any:
        """Return a scalar, or a list or mapping of such."""
        kind = self.rng.random()
        if depth and kind < 0.2:
            return [self.value(depth - 1) for _ in range(self.few())]
        if depth and kind < 0.4:
            return {self.text(): self.value(depth - 1) for _ in range(self.few())}
        return self.rng.choice(SCALARS) if kind < 0.7 else self.text()

    def changed(self, value: Any) -> Any:
        """Return a value with one part of it left out, doubled, or replaced by another."""
        what = self.rng.random()
        if not isinstance(value, dict | list) or not value or what < 0.05:
            return self.value()
        place = self.rng.randrange(len(value))
        entries = list(value.items()) if isinstance(value, dict) else list(enumerate(value))
        key, entry = entries[place]
        entries[place : place + 1] = (
            []
            if what < 0.15
            else [(key, entry), (self.text(), entry)]
            if what < 0.25
            else [(key, self.changed(entry))]
        )
        return dict(entries) if isinstance(value, dict) else [entry for _, entry in entries]

    def mutated(self, text: str) -> bytes:
        """Return a text with a few parts of it cut, doubled, moved or replaced."""
        rng = self.rng
        for _ in range(1 + self.few()):
            words = [found.span() for found in re.finditer(r"[\w.+-]+", text[:20_000])] or [(0, 0)]
            start, end = rng.choice(words)
            if rng.random() < 0.3:
                start, end = sorted(rng.randint(0, len(text)) for _ in range(2))
            before, part, after = text[:start], text[start:end], text[end:]
            lines = text.split("\n")
            swapped = rng.sample(lines, len(lines)) if rng.random() < 0.3 else lines[::-1]
            (text,) = rng.choices(
                [
                    *(before + self.text() + after, before + self.text() + part + after),
                    *(before + after, before + part + part + after, before, "\n".join(swapped)),
                    *(before + rng.choice(BOMBS) + after, rng.choice(BOMBS)),
                ],
                [8, 4, 2, 2, 1, 1, 0.5, 0.1],
            )
        data = text.encode("utf-8", "replace")
        if rng.random() < 0.1:
            place = rng.choice([0, rng.randint(0, len(data))])
            data = data[:place] + rng.choice(BYTES) + data[place:]
        return (
            text.encode(rng.choice(["utf-16", "cp1252"]), "replace")
            if rng.random() < 0.03
            else data
        )

    def file(self, text: str) -> bytes:
        """Return the content of a file: changed in its values, mutated in its letters, made up."""
        kind = self.rng.random()
        if kind < 0.35:
            with contextlib.suppress(ValueError):  # no JSON: of this kind its letters are mutated
                return json.dumps(self.changed(json.loads(text)), ensure_ascii=False).encode(
                    "utf-8", "replace"
                )
        if kind < 0.9:
            return self.mutated(text)
        return self.mutated(json.dumps(self.value(), ensure_ascii=False)) if kind < 0.95 else b""


# What is asked of each input ---------------------------------------------------------------------


class Counts:
    """What came of inputs; a traceback is kept with what led to it."""

    def __init__(self) -> None:
        self.found: Counter[str] = Counter()
        self.faults: list[str] = []
        self.slowest = 0.0

    def tried(self, what: str, call: Callable[[], object]) -> None:
        """Call something that may refuse in a sentence, and may do nothing worse."""
        begun = time.perf_counter()
        try:
            call()
            self.found["taken"] += 1
        except (InswsnError, BuildError) as refusal:
            self.found["refused"] += 1
            said = str(refusal)
            if not said or "Traceback" in said or len(said) > 1001:
                self.faults.append(f"{what}: not a sentence: {said[:300]!r}")
        except Exception:
            self.found["tracebacks"] += 1
            self.faults.append(f"{what}:\n{traceback.format_exc()[-1500:]}")
        self.slowest = max(self.slowest, time.perf_counter() - begun)

    def worst(self) -> str:
        """Return the faults, one of each kind: by the last line of what was told."""
        kinds = {fault.strip().splitlines()[-1][:80]: fault for fault in self.faults}
        return "\n\n".join(kinds.values())

    def told(self) -> str:
        """Return the figures."""
        return (
            f"{self.found['taken']} taken, {self.found['refused']} refused in a sentence, "
            f"{self.found['tracebacks']} tracebacks, the slowest {self.slowest:.1f} s"
        )


def computed(_: Project, request: runs.Request, *others: object) -> runs.Run:
    """Return what the published run of a chapter has, as a run of a request."""
    results = runs.reference_results(Project(ROOT), request.chapter)
    checked = chapter_schema(ROOT, request.chapter).check(request.parameters)
    if request.core:  # one method in one column
        found = {"name": "a.left", "value": 1.0, "interval": (0.5, 2.0), "runs": 40}
        one = results.quantities[0].model_copy(update=found)
        results = results.model_copy(update={"quantities": (one,)})
    words = {
        "methods": {"a": "A"}, "headline": "left", "leader": {"best": "a", "error": 1.0},
    }  # fmt: skip
    title = '{"cell_type": "markdown", "id": "a", "metadata": {}, "source": "# A title"}'
    notebook = f'{{"cells": [{title}], "metadata": {{}}, "nbformat": 4, "nbformat_minor": 5}}'
    files = {"scores.json": json.dumps(words)} if request.core else {}
    return runs.Run(request, results.model_copy(update={"parameters": checked}), notebook, files)


ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Project:
    """A copy of the checkout in which nothing is computed or rendered."""

    def cells(
        client: object, project: Project, fresh: bool, due: dict[int, Any], ended: Any
    ) -> None:
        for cell, request in due.items():
            ended(cell, computed(project, request))

    for name in ("_config.yml", "environment.lock", "environment-torch.lock", "CITATION.cff"):
        shutil.copy(ROOT / name, tmp_path / name)
    shutil.copytree(ROOT / "data", tmp_path / "data")
    for name in ("chapters", "book"):
        shutil.copytree(
            ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.ipynb", "*.py")
        )
    monkeypatch.setattr(runs, "_run_and_keep", computed)
    monkeypatch.setattr(runs, "keep", lambda *_: None)
    monkeypatch.setattr(sweep, "keep", lambda *_: None)
    monkeypatch.setattr(sweep, "_client", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr(sweep, "_compute", cells)
    monkeypatch.setattr(chapters, "render_book", lambda *_, **__: None)
    monkeypatch.setattr(chapters, "render_run", lambda *_: None)
    everything = [computed(Project(ROOT), runs.Request(c.id)) for c in Project(ROOT).chapters()]
    monkeypatch.setattr(compare, "book_runs", lambda _: everything)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(os, "fsync", lambda _: None)  # it waits for the disk
    monkeypatch.chdir(tmp_path)
    return Project(tmp_path)


# Files -------------------------------------------------------------------------------------------


def pieces(content: dict[str, Any], name: str, length: int) -> list[str]:
    """Return files with a few entries each of a long list."""
    entries = content[name]
    places = range(0, len(entries), length)
    return [json.dumps({**content, name: entries[k : k + length]}) for k in places]


def readers(project: Project) -> dict[str, tuple[str, list[str], Callable[[Path], object]]]:
    """Return, of each kind of file, a name, valid texts, and what reads them."""
    root, data = project.root, project.root / "data"
    published = [read_results(path) for path in sorted(project.published.glob("*.json"))]
    claims = load_claims(data / "claims")
    schema = chapter_schema(root, "p1-training")
    inertial = load_scenario(data / "scenarios/p1-inertial.yaml")

    def texts(*names: str) -> list[str]:
        return [(data / name).read_text(encoding="utf-8") for name in names]

    def scenario(path: Path) -> None:
        from_settings(Scene, inertial | load_scenario(path))

    def table(path: Path) -> None:
        for cell in read_table(path, "method").to_numpy().ravel():
            interval(cell)

    def results(path: Path) -> None:
        own = read_results(path)
        verdicts(claims, [own, *(each for each in published if each.chapter != own.chapter)])

    def citation(path: Path) -> None:
        other = Project(root)
        other.root = path.parent
        other.about()

    recording = texts("examples/ins-wsn.csv")[0].split("\n")
    scenarios = texts("scenarios/p1.yaml")
    scenarios.append(json.dumps(read_yaml(data / "scenarios/p1.yaml")))
    ledger, errata, readings = (
        read_yaml(data / f"{name}.yaml") for name in ("claims/p2", "errata", "readings")
    )
    verdict = json.dumps([{"id": claim.id, "verdict": "reproduced"} for claim in claims[:5]])
    cell = "\n```{code-cell}"  # the head of a chapter, and its parameters
    sources = [
        cell.join(path.read_text("utf-8").split(cell)[:4])
        for path in sorted((root / "chapters").rglob("*.md"))
    ]
    return {
        "parameters": (
            "a.yml", ["q_scale: 0.1\nruns: 200\nvelocity_source: window\n", "runs: 64 # a\nseed: 7",
            '{"seed": 3, "speed": 7.2, "solver": "scs"}'],
            lambda path: gather_parameters(schema, (), path, data),
        ),
        "recordings": (
            "a.csv", ["\n".join(recording[:n]) for n in (12, 30, 60)], iw.read_recording,
        ),
        "printed tables": ("a.csv", texts("papers/p1-table2.csv", "papers/p1-table3.csv"), table),
        "printed numbers": ("a.yaml", texts("papers/p1.yaml", "papers/p2.yaml"), read_numbers),
        "ledgers": (
            "a.yaml", pieces(ledger, "claims", 3),
            lambda path: verdicts(load_claims(path), published),
        ),
        "errata": (
            "errata.yaml", pieces(errata, "errata", 2),
            lambda path: review.load_entries(path, review.Errata),
        ),
        "readings": (
            "readings.yaml", pieces(readings, "questions", 2),
            lambda path: review.load_entries(path, review.Readings),
        ),
        "assumptions": ("a.yaml", [texts("assumptions.yaml")[0][:3000]], read_yaml),
        "scenarios": ("a.yaml", scenarios, scenario),
        "results": ("61.json", texts("published/61.json", "published/which-filter.json"), results),
        "verdicts": ("a.json", [verdict], read_verdicts),
        "recorded trials": ("a.json", texts("recorded/p3-drive.json"), read_trials),
        "kept studies": ("a.json", texts("recorded/uwb-fixes.json"), read_json),
        "citations": ("CITATION.cff", [(root / "CITATION.cff").read_text("utf-8")], citation),
        "chapters": ("00-a.md", sources, lambda path: read_source(Chapter("00-a", path))),
    }  # fmt: skip


def try_files(checkout: Project, inputs: Inputs, counts: Counts, count: int) -> None:
    """Read files of all kinds."""
    kinds = readers(checkout)
    for number in range(count):
        kind = list(kinds)[number % len(kinds)]
        name, texts, read = kinds[kind]
        content = inputs.file(inputs.rng.choice(texts))
        path = checkout.root / "own" / name
        path.write_bytes(content)
        counts.tried(f"{kind}: {content[:300]!r}", lambda: read(path))  # noqa: B023


# What a parameter is, in a file and on a command line --------------------------------------------


WHOLE, REAL, TRUTH = read_schema(
    "# A.\na: int = 1  # 1; any\n# B.\nb: float = 1.0  # 1; any\n# C.\nc: bool = True  # 1; any\n"
).parameters
#: What YAML takes for a text without quotes, as a whole
PLAIN = re.compile(r"(?!-+$)[\w.+~½-][\w.+:~½-]*")


def try_parameters(checkout: Project, inputs: Inputs, counts: Counts, count: int) -> None:
    """Give a text in a file and on the command line: it is the same, or refused in both."""
    path = checkout.root / "own" / "a.yaml"
    for _ in range(count):
        parameter, text = inputs.rng.choice([WHOLE, REAL, TRUTH]), inputs.text()
        if not PLAIN.fullmatch(text):
            text = str(inputs.rng.randint(-99, 99))
        path.write_text(f"{parameter.name}: {text}\n", encoding="utf-8")
        given: tuple[tuple[list[str], Path | None], ...] = (
            ([], path), ([f"{parameter.name}={text}"], None),
        )  # fmt: skip
        found = []
        for words, file in given:
            with contextlib.suppress(InswsnError):
                found.append(gather_parameters(Schema((parameter,)), words, file, path.parent))
        counts.found["taken" if found else "refused"] += 1
        if len(found) == 1 or found[:1] != found[1:]:
            counts.faults.append(f"{parameter.name}: {text!r} is {found}")


# Command lines -----------------------------------------------------------------------------------


#: Folders to write, some of which may not be; a name that is no UTF-8 comes as Python has it
OUT = ["own/run", "own/run", "own/é/b", "own/\udcff", "data", "own/parameters.yml", "x" * 300]
#: Values of a parameter that names a file, or a learner
FILES = ["examples/ins-wsn.csv", "own/\udcff.csv", "data", "own/none.csv"]
LEARNERS = ["sklearn.linear_model:Ridge", "sklearn.cluster:KMeans", "no.such:Thing", "json:loads"]


class Lines:
    """Command lines of all commands, with all their options."""

    def __init__(self, inputs: Inputs, project: Project) -> None:
        self.inputs, self.rng, self.project = inputs, inputs.rng, project
        self.chapters = [chapter.id for chapter in project.chapters()]
        self.number = "00"

    def line(self) -> list[str]:
        """Return the words of a command line."""
        name = self.rng.choice(sorted(cli.commands))
        words = []
        self.number = self.rng.choice(self.chapters)
        for parameter in cli.commands[name].params:
            often = 1 if parameter.required else 3 if parameter.multiple else 2
            for _ in range(often):
                if parameter.required or self.rng.random() < 0.2:
                    words += self.given(parameter)
        if self.rng.random() < 0.05:
            words.insert(self.rng.randint(0, len(words)), self.odd())
        root = self.odd() if self.rng.random() < 0.03 else str(self.project.root)
        return ["--root", root, name, *words]

    def given(self, parameter: Any) -> list[str]:
        """Return an option or an argument, with a value that it might have, or an odd one."""
        flag = [parameter.opts[0]] if isinstance(parameter, click.Option) else []
        if getattr(parameter, "is_flag", False):
            return flag
        kind = "odd" if self.rng.random() < 0.05 else parameter.name
        value = {
            "name": lambda: self.number, "settings": lambda: self.setting(1),
            "axes": lambda: self.setting(self.rng.randint(1, 4)),
            "file": lambda: "own/parameters.yml", "before": lambda: "data/published/61.json",
            "after": lambda: f"data/published/{self.rng.choice(['61', '61', '90'])}.json",
            "against": lambda: "own/verdicts.json",
            "results": lambda: "data/published", "jobs": lambda: str(self.rng.randint(-1, 4)),
            "paper": lambda: "P1", "kind": lambda: "numeric", "verdict": lambda: "reproduced",
            "out": lambda: self.rng.choice(OUT),
        }.get(kind, self.odd)()  # fmt: skip
        return [*flag, value]

    def odd(self) -> str:
        """Return an odd word; what is no UTF-8 comes as Python has it."""
        # a rooted path is a place outside, where no test writes
        text = self.inputs.text().replace("\0", "").lstrip("/")
        return text + "\udcff" if self.rng.random() < 0.05 else text

    def setting(self, many: int) -> str:
        parameters = chapter_schema(self.project.root, self.number).parameters
        if not parameters or self.rng.random() < 0.05:
            return f"{self.odd()}={self.odd()}"
        chosen = self.rng.choice(parameters)
        return f"{chosen.name}={','.join(self.fitting(chosen) for _ in range(many))}"

    def fitting(self, parameter: Parameter) -> str:
        """Return a value that is likely to be allowed, or not."""
        if self.rng.random() < 0.1 or parameter.kind in ("str", "bool"):
            kinds = {FILE_RULE: FILES, REGRESSOR_RULE: LEARNERS}
            words = kinds.get(parameter.rule, parameter.rule.removeprefix("one of ").split(", "))
            return self.rng.choice([*words, *4 * [str(parameter.default)], self.odd()])
        near = float(parameter.default) * self.rng.choice([0.99, 1, 1, 1.01, 2, -1])
        return str(int(near)) if parameter.kind == "int" else str(near)


def call(words: list[str]) -> tuple[int, str]:
    """Call the command in this process; return its status, and what it says of a mistake."""
    out, err = (
        io.TextIOWrapper(io.BytesIO(), "utf-8", errors) for errors in ("strict", "backslashreplace")
    )
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        sys.argv[1:] = words
        try:
            run_command(cli)
        except SystemExit as ended:
            err.flush()
            return int(ended.code or 0), err.buffer.getvalue().decode()  # type: ignore[attr-defined]
    raise AssertionError("A command ends by sys.exit.")


def try_command_lines(checkout: Project, inputs: Inputs, counts: Counts, count: int) -> None:
    """Call commands."""
    lines = Lines(inputs, checkout)

    def one(words: list[str]) -> None:
        status, said = call(words)
        if status:
            assert status in (1, 2), status
            assert re.search(r"^(inswsn|Error): ", said, re.MULTILINE), said
            raise (InswsnError if status == 2 else BuildError)(said.strip().splitlines()[-1])

    for _ in range(count):
        words = lines.line()
        counts.tried(repr(words)[:600], lambda: one(words))  # noqa: B023


# All of it ---------------------------------------------------------------------------------------


def test_inputs(
    checkout: Project,
    size: Callable[[int, int], int],
    seed: int,
    tell: Callable[[str], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "argv", ["inswsn"])
    own = checkout.root / "own"
    own.mkdir()
    (own / "parameters.yml").write_text("seed: 7\n")
    shutil.copy(checkout.root / "data/examples/ins-wsn.csv", own / "\udcff.csv")
    verdict = [{"id": "P1-P-wsnacc", "verdict": "reproduced"}]
    (own / "verdicts.json").write_text(json.dumps(verdict))
    handlers = {each: signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGHUP)}
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    figures = []
    for try_them, count in (
        (try_files, size(80, 9_000)),
        (try_parameters, size(25, 2_000)),
        (try_command_lines, size(25, 2_000)),
    ):
        counts = Counts()
        try_them(checkout, Inputs(seed), counts, count)
        assert counts.worst() == ""
        assert min(counts.found[each] for each in ("taken", "refused")) > 0.1 * count, counts.found
        kind = try_them.__name__.removeprefix("try_").replace("_", " ")
        figures.append(f"{count} {kind}: {counts.told()}")
    for each, handler in handlers.items():
        signal.signal(each, handler)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024  # MB, on Linux
    assert grown < 200
    tell(f"{'; '.join(figures)}; {grown:.0f} MB more")

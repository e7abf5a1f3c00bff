"""The process of an entry: what it can see, what it may do, and how its failures are told."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import inswsn_lib
from inswsn_lib.benchmark import Answer, EntryError, Event, Task
from inswsn_lib.benchmark.processes import EntryProcess, find_entry
from inswsn_lib.errors import ParameterError
from inswsn_lib.files import DATA_VARIABLE

TASK = Task(("range",), 2, 1.0, anchors=np.eye(2), names=("a", "b"))
EVENTS = [
    Event(0.1, "range", np.array([0.1 + 0.2]), 1),
    Event(1.0, "ask", np.zeros(0)),
    Event(1.1, "range", np.array([7.0]), 0),
    Event(2.0, "ask", np.zeros(0)),
]
Answering = Callable[..., list[Answer | None]]


@pytest.fixture
def answers(tmp_path: Path) -> Answering:
    """Write an entry whose method `step` has a body, and return its answers."""

    def made(body: str, timeout: float = 300.0, head: str = "", **numbers: float):  # type: ignore[no-untyped-def]
        text = (
            "from inswsn_lib.benchmark import Answer\n\n"
            f"{head}\n"
            "class Mine:\n"
            "    def __init__(self, task):\n"
            "        self.task, self.last = task, 0.0\n"
            "    def step(self, event):\n" + textwrap.indent(textwrap.dedent(body), " " * 8)
        )
        file = tmp_path / "own" / "mine.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        with EntryProcess(find_entry(f"{file}:Mine"), timeout) as process:
            return process.answers(TASK, EVENTS, numbers)

    return made


def test_events_come_to_the_last_bit_and_answers_go_back(answers: Answering) -> None:
    """What it prints goes elsewhere; its numbers and the anchors are told."""
    found = answers(
        """
        print("hello")
        if event.kind != "ask":
            self.last = event.values[0]
            return None
        assert self.task.anchors.tolist() == [[1, 0], [0, 1]]
        assert self.task.names == ("a", "b")
        return Answer([self.last, self.task.numbers["gain"]], covariance=[[1, 0], [0, 1]])
        """,
        gain=0.1,
    )
    first, second = found
    assert first is not None
    assert second is not None
    assert np.asarray(first.position).tolist() == [0.1 + 0.2, 0.1]
    assert np.asarray(second.position).tolist() == [7.0, 0.1]
    assert first.velocity is None
    assert np.asarray(first.covariance).tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_what_is_later_is_nowhere_in_the_process(answers: Answering) -> None:
    """Through the array of an event, or all objects that Python knows of."""
    found = answers(
        """
        import gc
        known = [o for o in gc.get_objects() if type(o) is type(event)]
        assert all(o.time <= 1.0 for o in known) or event.time > 1.0
        assert event.values.base is None
        return Answer([len(known), 0.0])
        """
    )
    assert len(found) == 2


def test_what_a_test_plants_is_not_in_the_process(
    answers: Answering, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inswsn_lib, "PLANTED", EVENTS, raising=False)
    with pytest.raises(EntryError, match=r"failed: AttributeError: .*PLANTED.* \(line \d+ of mine"):
        answers("import inswsn_lib; return Answer(inswsn_lib.PLANTED[-1].values)")


def test_files_elsewhere_are_not_read(
    answers: Answering, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither by a path, nor by the folder that the user has set."""
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    secret = tmp_path / "reference.csv"
    secret.write_text("1,2", encoding="utf-8")
    with pytest.raises(EntryError, match=r"may not open .*reference\.csv"):
        answers(f"return Answer([len(open({str(secret)!r}).read()), 0])")
    with pytest.raises(EntryError, match="PermissionError"):
        answers(f"import numpy; return Answer(numpy.loadtxt({str(secret)!r}, delimiter=','))")
    with pytest.raises(EntryError, match="KeyError: 'INSWSN_DATA'"):
        answers("import os; return Answer([len(os.environ['INSWSN_DATA']), 0])")


def test_files_beside_the_entry_are_read(answers: Answering, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    weights = tmp_path / "own" / "weights.txt"
    weights.write_text("3 4", encoding="utf-8")
    found = answers(f"return Answer([float(x) for x in open({str(weights)!r}).read().split()])")
    assert [np.asarray(each.position).tolist() for each in found if each] == [[3.0, 4.0]] * 2


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("import socket; socket.create_connection(('127.0.0.1', 9))", "may not use the network"),
        ("import os; os.system('ls')", "may not start programs"),
        ("import subprocess; subprocess.run(['ls'])", "may not start programs"),
        ("return 1 / 0", r"failed: ZeroDivisionError: division by zero \(line 8 of mine.py\)"),
        ("raise SystemExit(3)", "failed: SystemExit: 3"),
        ("import os; os._exit(3)", "has ended with status 3"),
        ("return Answer([float('nan'), 0])", "invalid answer: position .* not NaN or inf"),
        ("return Answer([1, 2, 3])", "invalid answer: position .* not of shape"),
        ("return Answer([1, 2], [1])", "invalid answer: velocity .* not of shape"),
        ("return Answer([1, 2], covariance=[[1, 2], [2, 1]])", "not one with a negative eigen"),
        ("return [1, 2]", "step returned list, not an Answer or None"),
    ],
)
def test_a_failure_is_one_sentence(answers: Answering, body: str, said: str) -> None:
    with pytest.raises(EntryError, match=said) as caught:
        answers(body)
    assert "\n" not in str(caught.value)


def test_who_hangs_is_ended(answers: Answering) -> None:
    with pytest.raises(EntryError, match="has not answered within 3 s"):
        answers("if event.kind == 'ask':\n    import time; time.sleep(60)", timeout=3.0)


def test_an_entry_that_cannot_be_imported_is_told(answers: Answering) -> None:
    with pytest.raises(EntryError, match="failed: ModuleNotFoundError: No module named 'nowhere'"):
        answers("return None", head="import nowhere")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("Mine", "module:Class"),
        ("nowhere:Mine", "in a module that can be imported"),
        ("nowhere.py:Mine", "in a file that exists"),
        (lambda task: None, "at the top level of a file"),
    ],
)
def test_an_entry_that_is_nowhere_is_refused(entry: object, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        find_entry(entry)  # type: ignore[arg-type]


def test_an_entry_may_be_a_class_or_a_name_of_a_module() -> None:
    from inswsn_lib.benchmark.baselines import Network

    name = "inswsn_lib.benchmark.baselines:Network"
    assert find_entry(Network) == find_entry(name)
    assert find_entry(name).folder == Path(inswsn_lib.__file__).parent.resolve()

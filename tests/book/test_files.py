"""YAML is read as PyYAML reads it, but for what is refused; a folder is replaced whole."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from inswsn_book.files import replace_folder

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

FILES = sorted((Path(__file__).resolve().parents[2] / "data").rglob("*.yaml"))


def told(value: object) -> object:
    """Return what was read with numbers in powers of ten and dates as texts, in both ways."""
    if isinstance(value, dict):
        return {key: told(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [told(entry) for entry in value]
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return str(value)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_our_files_hold_what_pyyaml_finds_in_them(path: Path) -> None:
    theirs = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    assert told(read_yaml(path)) == told(theirs)


@pytest.mark.parametrize("text", ["[" * 100_000, "[" * 5_000 + "]" * 5_000, "- " * 100_000])
def test_too_deep_a_nesting_is_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "deep.yaml"
    path.write_text(text)
    with pytest.raises(InswsnError, match=r"deep\.yaml is not YAML"):
        read_yaml(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [("a: 1\na: 2\n", "the key a is repeated"), ("a: [", "is not YAML"), ("\x01", "is not YAML")],
)
@pytest.mark.parametrize("with_libyaml", [True, False])
def test_what_is_refused_with_libyaml_and_without(
    tmp_path: Path, text: str, said: str, with_libyaml: bool
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    code = f"import yaml\nyaml.__with_libyaml__ = {with_libyaml}\n"
    code += "from pathlib import Path\nfrom inswsn_lib.files import read_yaml\n"
    code += (
        f"try:\n    read_yaml(Path({str(path)!r}))\nexcept Exception as error:\n    print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert said in done.stdout


@pytest.fixture
def sites(tmp_path: Path) -> tuple[Path, Path]:
    """A new site, in a folder that is to go, and the place of the old one."""
    new, site = tmp_path / "temporary" / "new", tmp_path / "html"
    for folder, text in ((new, "new"), (site, "old")):
        folder.mkdir(parents=True)
        (folder / "index.html").write_text(text)
    return new, site


def test_a_folder_takes_the_place_of_another(sites: tuple[Path, Path]) -> None:
    new, site = sites
    replace_folder(site, new)
    assert (site / "index.html").read_text() == "new"
    assert not new.exists()


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_a_replacement_that_is_cut_short_puts_the_old_folder_back(
    sites: tuple[Path, Path], error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    new, site = sites
    rename = Path.rename

    def cut_short(path: Path, target: Path) -> Path:
        if path == new:
            raise error
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", cut_short)
    with pytest.raises(error):
        replace_folder(site, new)
    assert (site / "index.html").read_text() == "old"

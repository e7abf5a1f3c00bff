"""Studies that are kept in a checkout as one JSON file: how such a file is read."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from inswsn_lib.errors import InswsnError

_Model = TypeVar("_Model", bound=BaseModel)


def read_kept(path: Path, model: type[_Model], make: str) -> _Model:
    """Read a study and check its form.

    Parameters
    ----------
    path : Path
        The file.
    model : type
        The pydantic model of the whole file.
    make : str
        The goal of the Makefile that makes it, for the sentence of an error.

    Raises
    ------
    InswsnError
        If there is no such file, or it is not of the form; the sentence says where.
    """
    try:
        return model.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InswsnError(f"There is no {path}; make it with make {make}.") from None
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a study: it is not UTF-8.") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise InswsnError(f"{path} is not a study: {place}: {first['msg']}.") from None

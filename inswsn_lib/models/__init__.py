"""Models of how the error of an inertial navigation system evolves and is observed."""

from inswsn_lib.models.error_model import ErrorModel

__all__ = ["ErrorModel"]

"""Units in which columns are of one size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Scaling = Literal["none", "range", "standard"]


@dataclass(frozen=True, eq=False)
class Scale:
    """An affine map of columns; columns that do not vary are only moved.

    Attributes
    ----------
    middle, size : ndarray, (columns,) or (columns, runs)

    Examples
    --------
    Columns of very different size come to [-1, 1] and back; one that does not vary is only moved.

    >>> import numpy as np
    >>> from inswsn_lib.learning.scaling import Scale
    >>> values = np.array([[0.0, 1000.0, 7.0], [1.0, 2000.0, 7.0], [2.0, 3000.0, 7.0]])
    >>> scale = Scale.of(values, "range")
    >>> scale.there(values).tolist()
    [[-1.0, -1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    >>> bool((scale.back(scale.there(values)) == values).all())
    True
    """

    middle: Array
    size: Array

    @classmethod
    def of(cls, values: Array, scaling: Scaling) -> Scale:
        """Return the map of values, (rows, columns) or (rows, columns, runs), to a scaling.

        Parameters
        ----------
        values : ndarray, (rows, columns) or (rows, columns, runs)
            Each run has a map of its own.
        scaling : {"none", "range", "standard"}
            Nothing; to [-1, 1]; to mean 0 and deviation 1.

        Returns
        -------
        Scale
        """
        if scaling == "none":
            return cls(np.zeros(values.shape[1:]), np.ones(values.shape[1:]))
        low, high = values.min(axis=0), values.max(axis=0)
        if scaling == "range":
            middle, size = low / 2 + high / 2, high / 2 - low / 2
        else:
            middle, size = values.mean(axis=0), values.std(axis=0)
        # the deviation of equal numbers need not be 0 exactly
        return cls(middle, np.where((low < high) & (size > 0), size, 1.0))

    def there(self, values: Array) -> Array:
        """Return values in the new units."""
        return np.ascontiguousarray((values - self.middle) / self.size)

    def back(self, values: Array) -> Array:
        """Return values in the units that they came from."""
        return values * self.size + self.middle

"""Arrays over worlds seen as arrays over robots."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.mjcf.roles import Ids


class Columns:
    """Some columns of an array over worlds as rows of robots: worlds x places rows, all of one world after the other.

    With one robot a world, or one world, they are a view, and cost nothing: robots are alike, so that the columns of
    each are evenly spaced, and as far behind those of the one before.

    Args:
        array: live, (worlds, columns).
        columns: of the robot at each place, (places, k).
    """

    def __init__(self, array: Array, columns: Ids) -> None:
        self._array, self._columns = array, np.asarray(columns)
        places, k = self._columns.shape
        self._cells, self._rows = (-1, places, k), (len(array) * places, k)
        first, (apart, step) = int(self._columns[0, 0]), self._steps()
        even = (self._columns == first + apart * np.arange(places)[:, None] + step * np.arange(k)).all()
        self._view: Array | None = None
        if even and places == 1:
            self._view = array[:, first : first + step * k : step]
        elif even and len(array) == 1:
            one = array[0, first:]
            strides = apart * one.strides[0], step * one.strides[0]
            self._view = np.lib.stride_tricks.as_strided(one, (places, k), strides)

    def _steps(self) -> tuple[int, int]:
        """From a robot to the next, and from a column to the next; of one, any."""
        columns, (places, k) = self._columns, self._columns.shape
        apart = int(columns[1, 0] - columns[0, 0]) if places > 1 else 1
        return apart, int(columns[0, 1] - columns[0, 0]) if k > 1 else 1

    def get(self) -> Array:
        """Values (rows, k), which may change when the array does."""
        return self._array[:, self._columns].reshape(self._rows) if self._view is None else self._view

    def set(self, values: Array) -> None:
        """Write values (rows, k) into the array."""
        if self._view is None:
            self._array[:, self._columns] = np.broadcast_to(values, self._rows).reshape(self._cells)
        else:
            self._view[:] = values

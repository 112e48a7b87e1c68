"""Arrays over worlds seen as arrays over robots."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.mjcf.roles import Ids


class Columns:
    """Some columns of an array over worlds as rows of robots: worlds x places rows, all of one world after the other.

    With one robot a world and columns evenly spaced, which is the common case, they are a view, and cost nothing.

    Args:
        array: live, (worlds, columns).
        columns: of the robot at each place, (places, k).
    """

    def __init__(self, array: Array, columns: Ids) -> None:
        self._array, self._columns = array, np.asarray(columns)
        places, k = self._columns.shape
        self._rows, self._cells = (-1, k), (-1, places, k)
        first, *rest = self._columns[0].tolist()
        step = rest[0] - first if rest else 1
        even = step > 0 and self._columns[0].tolist() == list(range(first, first + step * k, step))
        self._view = array[:, first : first + step * k : step] if places == 1 and even else None

    def get(self) -> Array:
        """Values (rows, k), which may change when the array does."""
        return self._array[:, self._columns].reshape(self._rows) if self._view is None else self._view

    def set(self, values: Array) -> None:
        """Write values (rows, k) into the array."""
        if self._view is None:
            self._array[:, self._columns] = np.broadcast_to(values, self.get().shape).reshape(self._cells)
        else:
            self._view[:] = values

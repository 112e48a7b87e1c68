"""Statistics of frames that come in blocks: the same, to the bit, however they are cut, and whatever the other rows."""

import numpy as np

from omni_control.kinematics import Array
from omni_mj.scenarios.settings import PERIOD_S

PERCENTILE = 99
STATISTICS = ("max", f"p{PERCENTILE}", "mean", "rms")


class Mean:
    """Of what is known of each row; sums are made frame by frame, since another order would round otherwise.

    Args:
        shape: of the values of a frame.

    Attributes:
        count: of values that were known so far.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.count = np.zeros(shape, int)
        self._sum = np.zeros(shape)

    def add(self, values: Array) -> None:
        """Go on with values (frames, *shape), not a number where there is none."""
        known = ~np.isnan(values)
        self.count += known.sum(0)
        sums = np.cumsum(np.concatenate([self._sum[None], np.where(known, values, 0.0)]), axis=0)
        self._sum = sums[-1].copy()

    @property
    def value(self) -> Array:
        """Their mean so far, (*shape); not a number where none was known."""
        with np.errstate(invalid="ignore"):  # 0 / 0
            mean: Array = self._sum / self.count
        return mean


class Percentile:
    """The 99th of each row, linear between the two nearest values: exact, since the largest are kept, 1 % of them.

    Args:
        n: number of rows.
        frames: that a row has, at most: so many of its largest values matter at the end.
    """

    def __init__(self, n: int, frames: int) -> None:
        most = max(frames, 1)
        self._keep = most - int(_below(np.array(most))[0])
        self._largest = [np.empty((0, n))]
        self._count = np.zeros(n, int)

    @property
    def kept(self) -> int:
        """How many values of each row are held."""
        return sum(map(len, self._largest))

    def add(self, values: Array) -> None:
        """Go on with values (frames, n), not a number where there is none."""
        unknown = np.isnan(values)
        self._count += (~unknown).sum(0)
        self._largest.append(np.where(unknown, -np.inf, values))
        if self.kept > 2 * self._keep:
            self._largest = [self._cut()]

    @property
    def value(self) -> Array:
        """The percentile so far, (n,); not a number where no value was known."""
        ordered = np.sort(self._cut(), axis=0)
        if not len(ordered):
            return np.full(len(self._count), np.nan)
        below, share = _below(self._count)
        first, rows = len(ordered) - self._count, np.arange(len(self._count))
        near = [ordered[np.clip(first + i, 0, len(ordered) - 1), rows] for i in (below, below + 1)]
        known = self._count > 0
        low, high = (np.where(known, each, np.nan) for each in near)
        return low + share * (high - low)

    def _cut(self) -> Array:
        """The largest values that matter (frames, n), in no order."""
        values = np.concatenate(self._largest)
        if len(values) <= self._keep:
            return values
        return np.partition(values, len(values) - self._keep, axis=0)[-self._keep :].copy()


def _below(count: np.ndarray) -> tuple[np.ndarray, Array]:
    """Among so many values in order: which is the last that is not above the percentile, and how far that is beyond."""
    position = PERCENTILE / 100 * (count - 1)
    below = np.floor(position).astype(int)
    return below, position - below


class ErrorStatistics:
    """Maximum, 99th percentile, mean and root mean square of each row's errors.

    Args:
        n: number of rows.
        frames: that a row has, at most.
    """

    def __init__(self, n: int, frames: int) -> None:
        self._greatest, self._at = np.full(n, np.nan), np.zeros(n, int)
        self._percentile = Percentile(n, frames)
        self._mean, self._square = Mean((n,)), Mean((n,))

    def add(self, error: Array, first: int) -> None:
        """Go on with errors (frames, n) from the frame `first` on, not a number where a row has no frame."""
        filled = np.where(np.isnan(error), -np.inf, error)
        at = filled.argmax(0)
        greatest = error[at, np.arange(error.shape[1])]
        more = (greatest > self._greatest) | np.isnan(self._greatest)
        self._at[more] = first + at[more]
        self._greatest = np.where(more, greatest, self._greatest)
        self._percentile.add(error)
        self._mean.add(error)
        self._square.add(error**2)

    @property
    def value(self) -> dict[str, Array]:
        """Statistic of `STATISTICS` -> (n,) so far, not a number for a row without any frame."""
        rms = np.sqrt(self._square.value)
        values = self._greatest.copy(), self._percentile.value, self._mean.value, rms
        return dict(zip(STATISTICS, values, strict=True))

    @property
    def greatest_at_s(self) -> Array:
        """When the error is greatest for the first time, (n,) s; not a number for a row without any frame."""
        return np.where(np.isnan(self._greatest), np.nan, self._at * PERIOD_S)


class Effort:
    """Root mean square over the frames of the change of a command per second, of the magnitude over all axes.

    Args:
        shape: of the command in a frame, (..., axes); before the first it is zero.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._before = np.zeros(shape)
        self._square = Mean(shape[:-1])

    def add(self, command: Array) -> None:
        """Go on with velocities (frames, ..., axes), m/s; not a number where a row has no frame."""
        change = np.diff(command, axis=0, prepend=self._before[None]) / PERIOD_S
        self._square.add((change**2).sum(-1))
        if len(command):
            self._before = command[-1].copy()

    @property
    def square(self) -> Array:
        """Its square so far, (...) m^2/s^4."""
        return self._square.value

    @property
    def value(self) -> Array:
        """So far, (...) m/s^2; not a number for a row without any frame."""
        return np.sqrt(self.square)

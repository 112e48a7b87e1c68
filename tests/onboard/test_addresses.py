"""Arrays by their addresses."""

import numpy as np
import pytest
from omni_mj.onboard import addresses


@pytest.mark.parametrize(
    ("found", "kind"),
    [
        (addresses.floats, np.float64),
        (addresses.vectors, np.complex128),
        (addresses.numbers, np.int64),
        (addresses.words, np.int32),
        (addresses.truths, np.bool_),
    ],
)
def test_what_is_written_at_an_address_is_in_the_array(found, kind) -> None:  # type: ignore[no-untyped-def]
    array = np.zeros((2, 3), kind)
    there = found(addresses.of(array), (2, 3))
    assert there.dtype == kind
    there[1, 2] = 1
    np.testing.assert_array_equal(array, [[0, 0, 0], [0, 0, 1]])


def test_an_array_that_is_not_in_one_piece_has_no_address() -> None:
    with pytest.raises(ValueError, match=r"\(3, 2\) is not in one piece"):
        addresses.of(np.zeros((2, 3)).T)

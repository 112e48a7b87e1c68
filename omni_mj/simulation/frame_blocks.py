"""Blocks of recorded frames: the first ones in memory, later ones in a temporary file."""

import os
import tempfile
from contextlib import suppress
from typing import Any, BinaryIO

import numpy as np

from omni_control.kinematics import Array

MEMORY_BYTES = 32_000_000  # of blocks, from which on further blocks are moved to the file
RESERVED_BYTES = 1_000_000_000  # of the disk, and as much as all blocks for the trajectory table
ROWS_PER_WRITE = 64  # rows that are copied at once
# Where large temporary files belong: /tmp is often in memory.
FOLDER = os.environ.get("TMPDIR", "/var/tmp")


class FrameBlocks:
    """Arrays of shape (frames, columns, n), to which no more frames are added.

    The file has no name, so the system removes it with the process. A block that the disk has no
    room for stays in memory.
    """

    def __init__(self) -> None:
        # Arrays in memory; or the shape and the position of an array in the file.
        self._blocks: list[Array | tuple[tuple[int, ...], int]] = []
        self._n_bytes = 0
        self._file: BinaryIO | None = None
        self._file_bytes = 0

    def append(self, block: Array) -> None:
        """Add a block."""
        self._n_bytes += block.nbytes
        if self._n_bytes > MEMORY_BYTES:
            with suppress(OSError):
                self._blocks.append((block.shape, self._write(block)))
                return
        self._blocks.append(block)

    def __len__(self) -> int:
        return len(self._blocks)

    def __getitem__(self, index: int) -> Array:
        """Return a block. The data of a block in the file is not loaded before it is used."""
        block = self._blocks[index]
        if isinstance(block, np.ndarray):
            return block
        shape, offset = block
        mapped: Array
        size = shape[::-1]
        mapped = np.memmap(self._file, float, "r", offset, size)  # type: ignore[call-overload]
        return mapped.T

    def __getstate__(self) -> dict[str, Any]:
        """Copy and pickle all blocks as arrays in memory."""
        blocks = [np.array(self[i]) for i in range(len(self))]
        return vars(FrameBlocks()) | {"_blocks": blocks, "_n_bytes": self._n_bytes}

    def _write(self, block: Array) -> int:
        """Write a block to the file, row by row, and return its position.

        Raises:
            OSError: The disk has no room for it.
        """
        if self._file is None:
            self._file = tempfile.TemporaryFile(dir=FOLDER)  # noqa: SIM115
        disk = os.statvfs(self._file.fileno())
        start = position = self._file_bytes
        if disk.f_bavail * disk.f_frsize < RESERVED_BYTES + self._n_bytes + block.nbytes:
            raise OSError
        for row in range(0, block.shape[2], ROWS_PER_WRITE):
            data = np.ascontiguousarray(block[..., row : row + ROWS_PER_WRITE].T)
            if os.pwrite(self._file.fileno(), data.data, position) < data.nbytes:
                raise OSError
            position += data.nbytes
        self._file_bytes = position
        return start

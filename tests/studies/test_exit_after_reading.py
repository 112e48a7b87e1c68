"""Test programs that exit right after reading a table."""

import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

READ = """
import sys
from pathlib import Path
from omni_mj.io import parquet
parquet.read_table(Path(sys.argv[1]))
"""


def test_program_that_exits_after_reading_is_not_aborted(tmp_path: Path) -> None:
    """Threads of Arrow that hold a Python file aborted one in six of eight parallel processes."""
    file = tmp_path / "wide.parquet"
    pq.write_table(pa.table({f"c{i}": [float(i)] * 8000 for i in range(60)}), file)
    processes = [
        subprocess.Popen([sys.executable, "-c", READ, str(file)], stderr=subprocess.PIPE)
        for _ in range(8)
    ]
    assert [(p.communicate()[1], p.returncode) for p in processes] == [(b"", 0)] * 8

"""Programs that end as soon as they have read a table end well."""

import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

READ = "import sys; from pathlib import Path; from omni_mj import parquet; parquet.read_table(Path(sys.argv[1]))"


def test_program_that_exits_after_reading_is_not_aborted(tmp_path: Path) -> None:
    """By threads of Arrow's that hold Python's file: one in six was, of eight side by side on two cores."""
    file = tmp_path / "wide.parquet"
    pq.write_table(pa.table({f"c{i}": [float(i)] * 8000 for i in range(60)}), file)
    processes = [
        subprocess.Popen([sys.executable, "-c", READ, str(file)], stderr=subprocess.PIPE)
        for _ in range(8)
    ]
    assert [(each.communicate()[1], each.returncode) for each in processes] == [(b"", 0)] * 8

"""A run opens no connection to another machine and sends no usage statistics."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import SHORT, split_words

RUN = "run --scenario rect --plant kinematic --controller flc --no-figures --quiet"


def test_a_run_makes_no_connection(tmp_path: Path) -> None:
    """The system calls show connections of Python and of all libraries."""
    calls = tmp_path / "calls"
    strace = shutil.which("strace")
    options = "-f", "--seccomp-bpf", "-o", calls  # only the calls that are traced stop the program
    if strace is None or subprocess.run([strace, *options, "true"], capture_output=True).returncode:
        pytest.skip("needs strace, and to be let")
    traced = [strace, *options, "-e", "trace=connect,bind,sendto,sendmsg,sendmmsg"]
    run = split_words("-m omni_mj", RUN, SHORT, "--out", tmp_path / "out")
    subprocess.run([*traced, sys.executable, *run], check=True, timeout=300)
    assert (tmp_path / "out" / "recording.rrd").exists()
    assert [line for line in calls.read_text().splitlines() if "AF_INET" in line] == []

"""Threads and finalisers that a controller of a user's leaves behind: a line each, and none holds up the end."""

import subprocess
import sys

STRAYS = """
import threading, time
from omni_mj.cli import strays


class Dropped:
    def __del__(self):
        raise ValueError("dropped")


strays.attend()
failing = threading.Thread(target=lambda: 1 / 0, name="mine")
failing.start()
failing.join()
Dropped()
strays.WAIT_S = 0.1
threading.Thread(target=time.sleep, args=(1000,)).start()
strays.leave(3)
"""


def test_what_is_left_behind_is_told_and_not_waited_for() -> None:
    done = subprocess.run([sys.executable, "-c", STRAYS], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (3, "")
    first, second, third = done.stderr.splitlines()
    assert first == "note: ZeroDivisionError: division by zero in the thread mine"
    assert second.startswith("note: ValueError: dropped ")
    assert third == "note: a controller's threads do not end; the program ends without them"

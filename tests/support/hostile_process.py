"""Controllers that do harm to the process they are in, or beyond; from this file each has one of its own."""

import ctypes
import faulthandler
import os
import random
import signal
import subprocess
import threading
import time
from typing import ClassVar

import numpy as np
from hostile import Honest


class Endless(Honest):
    """In compiled code that lets nothing else run, also no signal."""

    patience_s: ClassVar[float] = 0.5

    def spoil(self, seen):
        sum(range(10**15))


class Leaves(Honest):
    def spoil(self, seen):
        os._exit(0)


class Crashes(Honest):
    def spoil(self, seen):
        faulthandler.disable()  # pytest's, which would say all that it knows
        ctypes.string_at(0)


class Kills(Honest):
    """All that belongs together with it, as far as it knows."""

    def spoil(self, seen):
        os.killpg(0, signal.SIGKILL)


class Patches(Honest):
    def spoil(self, seen):
        np.asarray = np.isfinite = random.random = lambda *_, **__: None


class Closes(Honest):
    def spoil(self, seen):
        os.closerange(0, 200)


class Orphans(Honest):
    """Leaves another process behind that has all that it had."""

    def spoil(self, seen):
        if not os.fork():
            time.sleep(1000)
        os._exit(5)


class Odd(Honest):
    """Says what cannot be sent."""

    def spoil(self, seen):
        self.channels = {"x": lambda: 0}


class Forks(Honest):
    """And both would answer."""

    def spoil(self, seen):
        os.fork()


class Threads(Honest):
    def spoil(self, seen):
        threading.Thread(target=time.sleep, args=(1000,)).start()


class Starts(Honest):
    """A program that goes on when it does not."""

    def spoil(self, seen):
        process = subprocess.Popen(["sleep", "1000"])
        self.channels = {"pid": np.full(len(seen.pose), float(process.pid))}


FAIL = {
    Endless: "did not answer in frame 9: it was waited for for 0.5 s",
    Leaves: "ended its process in frame 9, with exit status 0",
    Crashes: "ended its process in frame 9, by SIGSEGV",
    Kills: "ended its process in frame 9, by SIGKILL",
    Patches: "failed in frame 9",
    Closes: "ended its process in frame 9",
    Orphans: "ended its process in frame 9, with exit status 5",
    Odd: "has a channel 'x' that is not of numbers in frame 9",
}
GO_ON = (Forks, Threads, Starts)

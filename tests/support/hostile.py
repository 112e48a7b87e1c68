"""Controllers that no robot should have: what each does goes wrong, or tries to spoil others' results."""

# ruff: noqa: NPY002

import os
import random
import sys
import threading
import time
import warnings
from contextlib import suppress
from typing import ClassVar

import numpy as np

from omni_control import Controller

AT = 9  # the frame in which they begin


class Honest(Controller):
    """What the others do until then, and what they should have been."""

    def command(self, frame, seen):
        if frame == AT:
            self.spoil(seen)
        target, speed = self.reference.at(frame, seen.pose)
        return speed + 3.0 * (target - seen.pose)

    def spoil(self, seen):
        """Do harm."""


# These fail.


class Exits(Honest):
    def spoil(self, seen):
        sys.exit(0)


class Interrupts(Honest):
    def spoil(self, seen):
        raise KeyboardInterrupt


class Unspeakable(Honest):
    class Error(Exception):
        def __str__(self):
            raise RuntimeError

    def spoil(self, seen):
        raise self.Error


class Loud(Honest):
    def spoil(self, seen):
        raise ValueError("\x1b[31mred\x07\n" + 5000 * "x")


class Deep(Honest):
    def spoil(self, seen):
        self.spoil(seen)


class Ragged(Honest):
    def command(self, frame, seen):
        return [[0, 0, 0], [1]] if frame == AT else 0 * seen.pose


class Text(Honest):
    def command(self, frame, seen):
        return np.full(seen.pose.shape, "1.0") if frame == AT else 0 * seen.pose


class Complex(Honest):
    def command(self, frame, seen):
        return seen.pose + 1j if frame == AT else 0 * seen.pose


class Infinite(Honest):
    def command(self, frame, seen):
        return seen.pose + np.inf if frame == AT else 0 * seen.pose


class Unsaid(Honest):
    def spoil(self, seen):
        self.channels = {"x": object()}


class Wide(Honest):
    def spoil(self, seen):
        self.channels = {"x": np.zeros((len(seen.pose), 100_000))}


class Hooks(Honest):
    """Into what Python calls by itself."""

    def spoil(self, seen):
        sys.excepthook = sys.unraisablehook = threading.excepthook = None
        sys.setprofile(lambda *_: 1 / 0)
        threading.setprofile(lambda *_: 1 / 0)
        sys.setrecursionlimit(60)


class Hangs(Honest):
    patience_s: ClassVar[float] = 0.3

    def spoil(self, seen):
        while True:
            time.sleep(0.01)


class Stubborn(Honest):
    """Neither can it be ended."""

    patience_s: ClassVar[float] = 0.3

    def spoil(self, seen):
        until = time.monotonic() + 5
        while time.monotonic() < until:
            with suppress(BaseException):
                time.sleep(0.01)


# These go on, and what they did to others shall be nothing.


class Writes(Honest):
    """Into all that it was given, also where it may not."""

    def spoil(self, seen):
        for given in (
            self.reference.poses, self.reference._rows, seen.pose, seen.twist, seen.measured, seen.sent.last(1),
            seen.sent._sent, self.told.geometry.azimuths,
        ):  # fmt: skip
            with suppress(ValueError):
                given.flags.writeable = True
                given[:] = 7


class Swaps(Honest):
    def spoil(self, seen):
        self.reference.poses = np.zeros((3, 3))
        self.reference._rows = np.zeros((3, 6))


class Cheats(Honest):
    """Wants to see the truth without saying so."""

    def spoil(self, seen):
        self.knows_truth = True


class Seeds(Honest):
    def spoil(self, seen):
        np.random.seed(0)
        random.seed(0)


class Closes(Honest):
    def spoil(self, seen):
        sys.stdout.close()
        sys.stderr = None
        warnings.simplefilter("error")
        np.seterr(all="raise")
        os.chdir("/")


class Prints(Honest):
    def spoil(self, seen):
        print("hello\nyou", 3)


class Races(Honest):
    def command(self, frame, seen):
        return np.full(seen.pose.shape, 1e308)


FAIL = (
    Exits,
    Interrupts,
    Unspeakable,
    Loud,
    Deep,
    Ragged,
    Text,
    Complex,
    Infinite,
    Unsaid,
    Wide,
    Hooks,
    Hangs,
    Stubborn,
)
GO_ON = (Writes, Swaps, Cheats, Seeds, Closes, Prints, Races)


class Dice(Honest):
    """Throws dice of both kinds, which it seeds when it is made."""

    def __init__(self, told, reference, n):
        super().__init__(told, reference, n)
        np.random.seed(3)
        random.seed(3)

    def command(self, frame, seen):
        self.channels = {"dice": np.full((len(seen.pose), 2), [np.random.random(), random.random()])}
        return super().command(frame, seen)

"""Ended in the middle: kills and signals at random moments, which no file may show, and after which one can go on."""

import os
import random
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import at
import laws
from programs import COMMANDS, Fork, signalled

NAMES = ("run", "compare", "sweep", "serve")
_TAKES_S: dict[str, float] = {}
MODULES = 1500  # that are imported by a run, about
Found = tuple[str, list[str]]  # what was done, and what was wrong
PHASES = {  # kinds of events (at.py), and how often each is a moment
    "open": 2,
    "provenance.json": 1,
    "summary.json": 2,
    ".parquet": 2,
    ".rrd": 1,
    "figures": 1,
    ".png": 1,
    "report.html": 1,
}


def undisturbed(folder: Path, name: str) -> tuple[Path, float]:
    """What a command leaves when nothing disturbs it, made once, and how long it takes, s."""
    out = folder / f"{name}-whole"
    if name not in _TAKES_S:
        began = time.monotonic()
        done = Fork([*COMMANDS[name], "--out", str(out)]).wait()
        assert done.code == 0, done.err
        _TAKES_S[name] = time.monotonic() - began
    return out, _TAKES_S[name]


def kills(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """SIGKILL at any time; afterwards the same command runs in the same folder, or a sweep goes on, to the same end."""
    for number in range(count):
        name = NAMES[number % len(NAMES)]
        whole, takes_s = undisturbed(folder, name)
        out, moment = folder / f"{name}-{number}", rng.uniform(0, takes_s)
        fork = Fork([*COMMANDS[name], "--out", str(out)])
        time.sleep(moment)
        fork.kill()
        done = fork.wait()
        wrong = laws.of_program(done.code, done.err, 0, -signal.SIGKILL)
        if out.exists():
            wrong += laws.of_folder(out, whole) + _again(name, out, whole)
        yield f"kill {name} after {moment:.2f} of {takes_s:.2f} s", wrong
        shutil.rmtree(out, ignore_errors=True)


def signals(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """SIGINT and SIGTERM in every phase, at events that repeat."""
    numbers: dict[tuple[str, str], int] = {}
    for number in range(count):
        name, (sent, code) = NAMES[number % len(NAMES)], rng.choice(list(laws.SIGNALS.items()))
        whole, _ = undisturbed(folder, name)
        (kind,) = rng.choices(list(PHASES), list(PHASES.values()))
        out = folder / f"{name}-{number}"
        words = [*COMMANDS[name], "--out", str(out)]
        if (name, kind) not in numbers:
            numbers[name, kind] = _events(kind, words)
            shutil.rmtree(out)
        if not numbers[name, kind]:
            continue
        at_event = rng.randint(1, numbers[name, kind])
        done = Fork(words, lambda kind=kind, at_event=at_event, sent=sent: at.send(kind, at_event, sent)).wait()
        wrong = laws.of_program(done.code, done.err, 0, code, -sent)
        if out.exists():
            wrong += laws.of_folder(out, whole)
        yield f"{sent.name} to {name} at {kind} {at_event} of {numbers[name, kind]}: {done.code}", wrong
        shutil.rmtree(out, ignore_errors=True)


def imports(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """SIGINT and SIGTERM while modules are imported, and while the program ends, in processes of their own."""
    for number in range(count):
        sent, code = rng.choice(list(laws.SIGNALS.items()))
        out, at_event = folder / str(number), rng.randint(1, MODULES)
        done = signalled("import", at_event, sent.name, [*COMMANDS["run"], "--no-figures", "--out", str(out)])
        yield f"{sent.name} at import {at_event}: {done.code}", laws.of_program(done.code, done.err, 0, code, -sent)


def _events(kind: str, words: list[str]) -> int:
    """How many events of a kind there are in a command."""
    ours, theirs = os.pipe()
    done = Fork(words, lambda: at.watch(kind, lambda seen: os.write(theirs, b"."))).wait()
    assert done.code == 0, done.err
    os.close(theirs)
    with open(ours, "rb") as pipe:
        return len(pipe.read())


def _again(name: str, out: Path, whole: Path) -> list[str]:
    """Go on after a kill: what is wrong with what comes of it."""
    words = [*COMMANDS[name], "--out", str(out), *["--overwrite"] * any(out.iterdir())]
    done = Fork(["sweep", "--resume", str(out)] if name == "sweep" and any(out.iterdir()) else words).wait()
    wrong = laws.of_program(done.code, done.err, 0) + laws.of_folder(out, whole)
    return [f"afterwards: {each}" for each in wrong]

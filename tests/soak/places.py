"""Where programs run: full disks, folders that cannot be written, no home, no display, one core, little memory."""

import os
import random
import resource
import shutil
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import laws
from moments import Found, undisturbed
from programs import COMMANDS, OMNI, Around, Ended

MB = 1_000_000
# Nobody, who may read all, since Python may be where only root does; and write where everybody may.
NOBODY = ("--reuid", "65534", "--regid", "65534", "--clear-groups")
READER = ("setpriv", *NOBODY, "--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search")
RUN = COMMANDS["run"]
# What glibc's loader says, and with which code it ends a program, where a new thread has no room for a library's data.
LOADER, LOADERS = "cannot allocate memory for thread-local data", 127


def places(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """Each place once."""
    whole, _ = undisturbed(folder, "run")
    yield from _surroundings(folder, whole)
    yield from _outputs(folder)
    yield from _one_core(folder, whole)
    if os.geteuid() == 0 and shutil.which(READER[0]):
        yield from _nobody(folder)


def disks(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """Disks that are full after as many bytes."""
    for number in range(count):
        yield _full_disk(rng, folder / f"disk-{number}", undisturbed(folder, "run")[0])


def memories(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """Memories that are too small, or nearly."""
    for number in range(count):
        yield _little_memory(rng, folder / f"memory-{number}", undisturbed(folder, "run")[0])


def _surroundings(folder: Path, whole: Path) -> Iterator[Found]:
    """What a terminal usually gives and a service does not; the numbers are the same."""
    gone: Mapping[str, Mapping[str, str | None]] = {
        "no HOME": {"HOME": None},
        "a HOME that is not there": {"HOME": str(folder / "nowhere"), "XDG_CACHE_HOME": None, "XDG_CONFIG_HOME": None},
        "no DISPLAY": {"DISPLAY": None, "WAYLAND_DISPLAY": None},
        "no TERM, no LANG": {"TERM": None, "LANG": None, "LC_ALL": "C"},
        "no PATH": {"PATH": None},
    }
    for title, env in gone.items():
        out = folder / title.replace(" ", "-")
        done = Around([*OMNI, *RUN, "--out", str(out)], env).run()
        yield title, laws.of_program(done.code, done.err, 0) + laws.of_folder(out, whole)
    done = Around([*OMNI, *RUN, "--view", "--out", str(folder / "view")], gone["no DISPLAY"]).run()
    yield "--view without a display", laws.of_program(done.code, done.err, 2)


def _outputs(folder: Path) -> Iterator[Found]:
    """Standard output and error that nobody reads, that are full, or that are closed."""
    words, shown = [*OMNI, *RUN, "--no-figures", "--overwrite", "--out", str(folder / "outputs")], [*OMNI, "list"]
    with Path("/dev/full").open("w") as full:
        for title, command in (("run", words), ("list", shown)):
            for name in ("stdout", "stderr"):
                done = Around(command, options={name: full}).run()
                yield f"{title}, {name} to a full device", _heard(done, name)
                done = Around(command, prepare=partial(os.close, 1 + (name == "stderr"))).run()
                yield f"{title}, {name} closed", _heard(done, name)
            line = subprocess.run(
                ["bash", "-c", 'set -o pipefail; "$@" | head -1', "bash", *command], capture_output=True, text=True
            )
            yield f"{title} | head -1", laws.of_program(line.returncode, line.stderr, 0, 128 + signal.SIGPIPE)


def _heard(done: Ended, lost: str) -> list[str]:
    """What is wrong with a program of which a stream was lost; who cannot be told a reason is told none."""
    wrong = laws.of_program(done.code, done.err, 0, 1)
    return [each for each in wrong if lost != "stderr" or each != laws.NO_REASON]


def _one_core(folder: Path, whole: Path) -> Iterator[Found]:
    """The same numbers as on all."""
    core = {min(os.sched_getaffinity(0))}
    out = folder / "one-core"
    done = Around([*OMNI, *RUN, "--out", str(out)], prepare=lambda: os.sched_setaffinity(0, core)).run()
    yield "one core", laws.of_program(done.code, done.err, 0) + laws.of_folder(out, whole)


def _nobody(folder: Path) -> Iterator[Found]:
    """Another user than root, who may write nowhere, or not into what is there."""
    folder.chmod(0o755)
    mine = folder / "mine"
    mine.mkdir(mode=0o777)
    mine.chmod(0o777)
    (theirs := mine / "theirs").mkdir(mode=0o755)
    cases: Mapping[str, tuple[Sequence[str], int]] = {
        "a current folder that is read-only": (RUN, 2),
        "a folder of somebody else's": ((*RUN, "--out", str(theirs)), 1),
        "below a folder of somebody else's": ((*RUN, "--out", str(theirs / "below")), 2),
        "a folder of its own": ((*RUN, "--out", str(mine / "own")), 0),
        "overwriting a run of somebody else's": ((*RUN, "--overwrite", "--out", str(folder / "run-whole")), 2),
        "going on with a sweep in one": (("sweep", "--resume", str(folder / "run-whole")), 2),
        "a report of somebody else's run": (("report", str(folder / "run-whole")), 2),
    }
    for title, (words, code) in cases.items():
        done = Around([*READER, *OMNI, *words], {"HOME": "/nonexistent"}, options={"cwd": folder}).run()
        yield f"as nobody: {title}", laws.of_program(done.code, done.err, code)


def _full_disk(rng: random.Random, out: Path, whole: Path) -> Found:
    """A disk of its own that is full after some bytes; without the right to make one, files that may not be larger."""
    name, size = rng.choice(("run", "compare", "sweep", "serve")), round(1000 * 10 ** rng.uniform(0, 2.8))
    out.mkdir()
    mounted = _quietly(["mount", "-t", "tmpfs", "-o", f"size={size}", "soak", str(out)])

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    try:
        here = out / "out"
        done = Around([*OMNI, *COMMANDS[name], "--out", str(here)], prepare=None if mounted else limit).run()
        wrong = laws.of_program(done.code, done.err, 0, 1, 2)
        if here.exists():
            wrong += laws.of_folder(here, whole) if name == "run" else laws.of_files(here)
        return f"{name} on a disk of {size // 1000} kB: {done.code} {done.err.strip()[-90:]}", wrong
    finally:
        _quietly(["umount", str(out)])
        shutil.rmtree(out, ignore_errors=True)


def _little_memory(rng: random.Random, out: Path, whole: Path) -> Found:
    """So many addresses, of which libraries and threads take most: a line, or the whole result."""
    name, most = rng.choice(("run", "compare", "sweep", "serve")), round(rng.uniform(300, 3000) * MB)
    limit = partial(resource.setrlimit, resource.RLIMIT_AS, (most, most))
    done = Around([*OMNI, *COMMANDS[name], "--out", str(out)], prepare=limit).run()
    ended = done.code == LOADERS and LOADER in done.err  # as by a kill: nobody is asked
    wrong = [] if ended else laws.of_program(done.code, done.err, 0, 1, 2)
    if out.exists():
        wrong += laws.of_folder(out, whole) if name == "run" else laws.of_files(out)
    shutil.rmtree(out, ignore_errors=True)
    return f"{name} with {most // MB} MB of addresses: {done.code} {done.err.strip()[-90:]}", wrong


def _quietly(words: Sequence[str]) -> bool:
    return subprocess.run(words, capture_output=True).returncode == 0

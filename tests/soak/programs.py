"""Commands that are disturbed: short ones of each kind, as processes of their own or as forks of one that is ready."""

import gc
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

os.environ.setdefault("MUJOCO_GL", "egl")  # for films; read when MuJoCo is imported, by whatever part comes first
HERE = Path(__file__).parent
OMNI = (sys.executable, "-m", "omni_mj")
PATIENCE_S = 150.0
SHORT = ("--set", "reference.waypoints=[[0, 0], [0.2, 0]]", "--set", "reference.settle_s=0.2")
MEANS = ("--plant", "kinematic", "--controller", "flc", "--controller", "comp-flc")
TWO = ("--scenario", "rect", "--scenario", "sprint")
NOISES = "vision.position_noise_m=0,0.01"
ANY_PORTS = ("--control-port", "0", "--blue-port", "0", "--yellow-port", "0")
COMMANDS: Mapping[str, Sequence[str]] = {
    "run": ("run", "--scenario", "rect", *SHORT, *MEANS, "--seeds", "2"),
    "compare": ("compare", *TWO, *SHORT, *MEANS, "--seeds", "2", "--trajectories"),
    "sweep": (
        "sweep",
        "--scenario",
        "rect",
        *SHORT,
        *MEANS,
        "--at-once",
        "2",
        "--vary",
        "vision.position_noise_m=0,0.01",
    ),
    "serve": ("serve", *ANY_PORTS, "--set", "wheels.model=two-rollers", "--speed", "100", "--for", "2"),
}


READY = (  # imported before forks, each of which then costs what its command does
    "matplotlib.pyplot", "mujoco.batch", "pyarrow.parquet", "rerun.blueprint", "scipy.signal", "scipy.optimize",
    "omni_mj.live.serve.server", "omni_mj.provenance.repeat", "omni_mj.show.figures", "omni_mj.show.recording",
    "omni_mj.show.recording.served", "omni_mj.show.report", "omni_mj.show.sweep_figure", "omni_mj.studies.limit",
)  # fmt: skip


@dataclass(frozen=True)
class Ended:
    """A program that ended.

    Args:
        code: its exit status; negative if a signal ended it.
        out: what it printed.
        err: what it said.
    """

    code: int
    out: str
    err: str


@dataclass
class Around:
    """What a program runs in.

    Args:
        words: of the program.
        env: variables that differ; None takes one away.
        prepare: called in the process before the program.
        options: further ones of `subprocess.Popen`.
    """

    words: Sequence[str]
    env: Mapping[str, str | None] = field(default_factory=dict)
    prepare: Callable[[], None] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def start(self) -> subprocess.Popen[str]:
        """Start it; signals are what they are in a terminal, also if this process ignores them."""

        def first() -> None:
            for each in (signal.SIGINT, signal.SIGTERM):
                signal.signal(each, signal.SIG_DFL)
            if self.prepare is not None:
                self.prepare()

        env = {name: value for name, value in {**os.environ, **self.env}.items() if value is not None}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.DEVNULL, "text": True}
        return subprocess.Popen(list(self.words), env=env, preexec_fn=first, **{**pipes, **self.options})

    def run(self) -> Ended:
        """Run it to its end."""
        with self.start() as process:
            return ended(process)


def ended(process: subprocess.Popen[str], patience_s: float = PATIENCE_S) -> Ended:
    """Wait for a program."""
    try:
        out, err = process.communicate(timeout=patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        err += f"\nFatal Python error: it did not end within {patience_s:g} s"
    return Ended(process.returncode, out or "", err or "")


def signalled(kind: str, number: int, name: str, words: Sequence[str]) -> Ended:
    """Run omni-mj with a signal at an event; see at.py."""
    return Around([sys.executable, str(HERE / "at.py"), kind, str(number), name, *words]).run()


class Fork:
    """A command as a fork of this process, in which everything is imported already: much quicker than one of its own.

    Args:
        words: after `omni-mj`.
        prepare: called in the fork before the command.
    """

    def __init__(self, words: Sequence[str], prepare: Callable[[], object] = lambda: None) -> None:
        for name in READY:
            import_module(name)
        gc.collect()
        self._out, self._err = (tempfile.TemporaryFile("w+") for _ in range(2))  # noqa: SIM115 (as long as the fork)
        sys.stdout.flush()
        self._status: int | None = None
        self.pid = os.fork()
        if not self.pid:
            self._become(list(words), prepare)

    def kill(self) -> None:
        """End it at once."""
        self.send(signal.SIGKILL)

    def send(self, number: signal.Signals) -> None:
        """Send it a signal, if it has not ended."""
        if not self.ended():
            os.kill(self.pid, number)

    def ended(self) -> bool:
        """Whether it has."""
        if self._status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self._status = status if pid else None
        return self._status is not None

    def wait(self) -> Ended:
        """Wait until it has ended."""
        until = time.monotonic() + PATIENCE_S
        while not self.ended():
            if time.monotonic() > until:
                self.kill()
            time.sleep(0.01)
        assert self._status is not None
        texts = []
        for file in (self._out, self._err):
            file.seek(0)
            texts.append(file.read())
            file.close()
        return Ended(os.waitstatus_to_exitcode(self._status), *texts)

    def _become(self, words: list[str], prepare: Callable[[], object]) -> NoReturn:
        from omni_mj.cli import console
        from omni_mj.cli.main import cli

        code = 1
        try:
            os.dup2(self._out.fileno(), 1)
            os.dup2(self._err.fileno(), 2)
            sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
            signal.signal(signal.SIGINT, signal.default_int_handler)
            for each in (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
                signal.signal(each, signal.SIG_DFL)
            prepare()
            console.invoke(cli, words)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            try:
                sys.stdout.flush()
                sys.stderr.flush()
            finally:
                os._exit(code)

"""Every command, ended by any signal at any time: never a traceback, never half a file."""

import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import laws
from moments import Found, undisturbed
from programs import ANY_PORTS, MEANS, SHORT, Fork

SUPPORT = Path(__file__).parents[1] / "support"
SENT = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGPIPE, signal.SIGKILL)
WITHIN_S = 8.0
LOG = "t,wheel_1,wheel_2,wheel_3,wheel_4\n" + "".join(f"{i / 60:.4f},{i},0,{i},1\n" for i in range(400))
FAST = ("--set", "wheels.model=two-rollers")


def commands(rng: random.Random, count: int, folder: Path) -> Iterator[Found]:
    """All in turn; of which of them a signal ends, by its default or by ours, there is a line or nothing at all."""
    whole, _ = undisturbed(folder, "run")
    log = folder / "log.csv"
    log.write_text(LOG)
    peer = [sys.executable, str(SUPPORT / "peer.py"), "--vision", "127.0.0.1:10920", "--port", "10931"]
    with subprocess.Popen(peer) as robots:
        try:
            for number in range(count):
                out = folder / f"everywhere-{number}"
                out.mkdir()
                every = _words(whole, log, out)
                name = list(every)[number % len(every)]
                yield _ended(name, every[name], out, rng.choice(SENT), rng.uniform(0, WITHIN_S))
                shutil.rmtree(out)
        finally:
            robots.kill()


def _words(whole: Path, log: Path, out: Path) -> Mapping[str, Sequence[str]]:
    """What each command is called with."""
    where = ("--out", str(out / "out"))
    driven = ("--vision", "127.0.0.1:10920", "--commands", "127.0.0.1:10931")
    return {
        "run": ("run", "--scenario", "rect", *FAST, *where),
        "compare": ("compare", "--scenario", "rect", "--scenario", "sprint", *SHORT, *MEANS, "--seeds", "2", *where),
        "sweep": ("sweep", "--scenario", "rect", *SHORT, *MEANS, "--vary", "carpet.friction=0.3,0.5", *where),
        "limit": ("limit", "rect", *SHORT, "--plant", "kinematic", "--seeds", "2", *where),
        "loop": ("loop", "--plant", "kinematic", "--controller", "flc", *where),
        "alpha": ("alpha", *FAST, *where),
        "slip": ("slip", *FAST, *where),
        "identify": ("identify", str(log), *where),
        "plan": ("identify", "--plan", *where),
        "serve": ("serve", *ANY_PORTS, *FAST, "--speed", "10", *where),
        "drive": ("drive", "--scenario", "rect", *SHORT, *driven, *where),
        "drive nobody": ("drive", "--scenario", "rect", "--vision", "127.0.0.1:10921", "--wait", "60", *where),
        "listen": ("drive", "--scenario", "rect", "--dry-run", *driven, "--duration", "60"),
        "listen to nobody": ("drive", "--dry-run", "--vision", "127.0.0.1:10921", "--wait", "60"),
        "film": ("film", str(whole), str(out / "film.gif")),
        "report": ("report", str(whole), "--out", str(out / "report.html")),
        "verify": ("verify", str(whole)),
        "new": ("new", "controller", str(out / "mine.py")),
        "list": ("list",),
    }


def _ended(name: str, words: Sequence[str], out: Path, sent: signal.Signals, moment: float) -> Found:
    """One of them, ended."""
    fork = Fork(words)
    time.sleep(moment)
    fork.send(sent)
    if sent == signal.SIGPIPE:  # which Python ignores, since writing then fails
        time.sleep(0.2)
        fork.send(signal.SIGTERM)
    done = fork.wait()
    codes = {signal.SIGPIPE: (143, -signal.SIGTERM)}.get(sent, (128 + sent, -sent))
    allowed = (0, 1, 2) if name == "identify" else (0,)  # its log says nothing
    return f"{sent.name} to {name} after {moment:.2f} s: {done.code}", [
        *laws.of_program(done.code, done.err, *allowed, *codes),
        *laws.of_files(out),
    ]

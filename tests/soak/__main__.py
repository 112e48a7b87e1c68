"""Machine faults, at random: `python tests/soak [--seed S]`, or `make soak`. What must hold is in laws.py.

It prints a line for each thing that went wrong, the seed with which that repeats, and exits with 1 if anything did.
"""

import argparse
import random
import sys
import tempfile
import time
from pathlib import Path

import everywhere
import hour
import moments
import places
import together

PARTS = {  # name -> what does it, and how often
    "kills": (moments.kills, 50),
    "signals": (moments.signals, 150),
    "commands": (everywhere.commands, 100),
    "imports": (moments.imports, 30),
    "places": (places.places, 1),
    "disks": (places.disks, 30),
    "memories": (places.memories, 20),
    "pairs": (together.pairs, 600),
    "hour": (hour.hour, 60),
}

EVERY = 10  # after how many there is a line that says so


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART[=COUNT]", help=f"of {', '.join(PARTS)} [all]")
    parser.add_argument("--seed", type=int, default=time.time_ns() % 10**6)
    parser.add_argument("--verbose", action="store_true", help="also what went well")
    given = parser.parse_args()
    print(f"seed {given.seed}", flush=True)
    bad = 0
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        for word in given.parts or PARTS:
            name, _, count = word.partition("=")
            part, usual = PARTS[name]
            done, most = 0, int(count or usual)
            for title, wrong in part(random.Random(given.seed), most, Path(folder)):
                done, bad = done + 1, bad + bool(wrong)
                if done % EVERY == 0:
                    print(f"{name}: {done} of {most}, {bad} wrong so far", flush=True)
                if wrong or given.verbose:
                    print(f"{name}: {title}: {'; '.join(wrong) or 'well'}", flush=True)
            print(f"{name}: {done} done", flush=True)
    print(f"{bad} went wrong (seed {given.seed})")
    return int(bad > 0)


sys.exit(main())

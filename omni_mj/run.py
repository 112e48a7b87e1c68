"""`python -m omni_mj.run`: run a scenario, show its result, leave its files."""

from omni_mj.cli import console
from omni_mj.cli.run import run

if __name__ == "__main__":
    console.invoke(run)

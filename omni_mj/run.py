"""`python -m omni_mj.run`: the same as `omni-mj run`."""

from omni_mj.cli import console
from omni_mj.cli.run_command import run_command

if __name__ == "__main__":
    console.run_program(run_command)

"""`python -m omni_mj.run`: the same as `omni-mj run`."""

import sys

if __name__ == "__main__":
    from omni_mj.cli import console
    from omni_mj.cli.run import command

    console.program(command)
else:
    # Importing a module sets it as an attribute of its package: `import omni_mj.run` would put this file in the place
    # of the function `omni_mj.run`. What is set is what stands in sys.modules.
    from omni_mj.studies.run import run

    sys.modules[__name__] = run  # type: ignore[assignment]

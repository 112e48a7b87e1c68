"""`python -m omni_mj`: the same as `omni-mj`."""

from omni_mj.cli.main import main

if __name__ == "__main__":
    main()

"""The console script `omni-mj`, which is also `python -m omni_mj`."""

import signal


def main() -> None:
    """Run the program. Ctrl-C while its modules are imported prints no traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from omni_mj.cli import console
    from omni_mj.cli.main import cli

    console.run_program(cli)


if __name__ == "__main__":
    main()

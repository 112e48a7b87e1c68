"""`omni-mj alpha`: where the motor correction factor alpha comes from."""

from pathlib import Path

import click

from omni_mj.cli import console, folders, options

OUTPUTS = ("summary.json", "scenario.toml", "alpha.png")


@click.command("alpha")
@options.SETTINGS
@click.option("--out", type=options.FOLDER, metavar="DIR", help="[runs/alpha-<UTC time>]")
@options.OVERWRITE
@options.QUIET
def command(overrides: tuple[str, ...], out: Path | None, overwrite: bool, quiet: bool) -> None:
    """Map alpha over carpet friction, winding temperature, battery charge and lint."""
    from omni_mj.cli.interrupts import Interrupts
    from omni_mj.scenarios import scenario
    from omni_mj.studies import alpha

    chosen = scenario.load("rect", overrides)
    folder = folders.prepare(out, "alpha", OUTPUTS, overwrite)
    with console.writing(folder), Interrupts() as interrupts, console.progress(quiet) as begin:
        show = begin("alpha", alpha.FRAMES + 1)

        def after_frame(frame: int) -> None:
            interrupts.check()
            if frame == 0:
                console.quiet_mujoco()
            show(frame)

        result = alpha.alpha(chosen, after_frame=after_frame)
    with console.writing(folder):
        result.save(folder)
        if result.study:
            from omni_mj.show import alpha_figure

            alpha_figure.save(result.study, folder / "alpha.png")
    if not quiet:
        print(result.table())
        left = ", ".join(output for output in OUTPUTS if (folder / output).exists())
        print(f"results in {folder}/ ({left}) after {result.wall_s:.0f} s")
    interrupts.end(result.stopped, f"nothing was measured; what there is is in {folder}")
    console.fail_rows({"alpha": result.failures})

"""`omni-mj export`: write a robot or a wheel as plain MJCF, in a folder as MuJoCo Menagerie's."""

import os
import re
import subprocess
import sys
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from omni_control.errors import OmniError
from omni_mj.cli import console, options, output_folders
from omni_mj.io.atomic_files import write_files, write_json
from omni_mj.mjcf.wheel_model import WheelDesign, render_wheel_files

_PICTURE_PROGRAM = """
import sys
import mujoco
from PIL import Image
model = mujoco.MjModel.from_xml_path(sys.argv[1])
model.vis.global_.offwidth, model.vis.global_.offheight = 960, 720
data, camera = mujoco.MjData(model), mujoco.MjvCamera()
mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
mujoco.mj_forward(model, data)
camera.lookat, camera.azimuth, camera.elevation = model.stat.center, 215, -28
camera.distance = 1.35 * model.stat.extent
with mujoco.Renderer(model, 720, 960) as renderer:
    renderer.update_scene(data, camera)
    Image.fromarray(renderer.render()).save(sys.stdout.buffer, "png")
"""
PICTURE_TIMEOUT_S = 60.0
_WHEEL_OPTIONS = [
    click.option(
        f"--{name.replace('_', '-')}",
        type=field.value_type if field.is_number else int,
        metavar="N",
        help=f"{field.doc.capitalize()}{field.unit and ', '}{field.unit}."
        + ("" if field.default is None else f" Default: {field.default:g}."),
    )
    for name, field in WheelDesign.describe_fields().items()
]


@click.command("export")
@options.robot_options
@click.option("--wheel", is_flag=True, help="Write a wheel of these sizes in place of a robot:")
@options.combine(*_WHEEL_OPTIONS)
@options.out_option("export")
@options.OVERWRITE
@options.QUIET
def export_command(
    scenario_options: options.ScenarioOptions,
    wheel: bool,
    out: Path | None,
    overwrite: bool,
    quiet: bool,
    **wheel_options: Any,
) -> None:
    """Write a robot, or a wheel alone, as plain MJCF, for any scene of MuJoCo.

    The folder has the robot, a scene with a floor, README.md with the source of each number, and a
    picture, as models of MuJoCo Menagerie do. The robot rolls with MuJoCo's default options.
    """
    from omni_mj.results import provenance

    sizes = {name: value for name, value in wheel_options.items() if value is not None}
    if sizes and not wheel:
        raise OmniError(f"--{next(iter(sizes)).replace('_', '-')} needs --wheel")
    if wheel and scenario_options != options.ScenarioOptions():
        raise OmniError("--wheel writes a wheel alone, without --robot, --model and --set")
    if wheel:
        name, files = "wheel", render_wheel_files(WheelDesign(**sizes))
    else:
        name, files = _collect_robot_files(scenario_options)
    picture = f"{name}.png"
    outputs = (*files, picture, output_folders.PROVENANCE[0])
    folder = output_folders.prepare_folder(out, "export", outputs, overwrite)
    record = {"study": "export", "command": console.get_command_line()}
    with console.report_write_errors(folder):
        # --overwrite recognizes the folder by it.
        record |= provenance.describe_environment()
        write_json(folder / output_folders.PROVENANCE[0], record)
        write_files(folder, files)
        reason = _draw_picture(folder / "scene.xml", folder / picture)
    if reason:
        warnings.warn(f"no {picture}, because MuJoCo cannot draw here: {reason}", stacklevel=1)
    if not quiet:
        print(console.describe_outputs(folder, outputs))


def _collect_robot_files(
    scenario_options: options.ScenarioOptions,
) -> tuple[str, dict[str, bytes]]:
    """Return the name of the model, and the contents of its files by their paths."""
    from omni_mj import __version__
    from omni_mj.config import robot_files
    from omni_mj.mjcf.model_readme import ModelOrigin, format_readme
    from omni_mj.mjcf.plain_model import build_plain_model

    robot = scenario_options.robot or robot_files.DEFAULT_ROBOT
    settings = scenario_options.load_scenario("rect").settings
    name = re.sub(r"[^\w-]", "_", Path(scenario_options.model or robot).stem, flags=re.ASCII)
    file = settings.model.file
    if name == "scene" or (file and f"{name}.png" in robot_files.read_model_files(Path(file))):
        name += "_robot"
    model = build_plain_model(settings, name)
    description, _ = robot_files.read_robot_file(robot)
    if file:
        description = f"{Path(file).name}, with motors and battery of {description}"
    origin = ModelOrigin(
        description,
        robot_files.find_robot_file(robot).read_text(encoding="utf-8").strip(),
        ", ".join(scenario_options.setting_overrides),
        console.get_command_line() or "",
        __version__,
    )
    today = f"{datetime.now(UTC):%Y-%m-%d}"
    files = dict(model.files)
    files["README.md"] = format_readme(settings, model, origin).encode()
    files["CHANGELOG.md"] = f"# Changelog\n\n## [{today}]\n\n- Initial release.\n".encode()
    if not file:
        files["LICENSE"] = (robot_files.find_models_folder() / "LICENSE").read_bytes()
    return model.name, files


def _draw_picture(scene: Path, picture: Path) -> str:
    """Draw a scene in another process, because a missing or broken GL can end it.

    Returns:
        The reason why there is no picture, or nothing.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PICTURE_PROGRAM, str(scene)],
            env={**os.environ, "MUJOCO_GL": console.OFFSCREEN_GL},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=PICTURE_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        return f"it took more than {PICTURE_TIMEOUT_S:g} s"
    if done.returncode == 0:
        picture.write_bytes(done.stdout)
        return ""
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else f"the renderer ended with code {done.returncode}"

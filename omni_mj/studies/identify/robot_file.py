"""The start robot's file with identified numbers in place of its own, each with its standard error in a comment."""

import json
import os
import re
import tomllib
from collections.abc import Container, Mapping, Sequence
from pathlib import Path

from omni_mj.mjcf.files import copies
from omni_mj.scenarios.settings import PERIOD_S
from omni_mj.studies.identify.findings import Estimate

Changes = dict[tuple[str, str], str]  # section and field -> value as TOML has it, and a comment
# (source, estimate) -> section and field of settings; commands tell what the team's computer believes.
FIELDS = {
    ("wheels", "radius_m"): ("wheels", "radius_m"),
    ("wheels", "arm_m"): ("wheels", "arm_m"),
    ("wheels", "creep_stiffness"): ("drive", "creep_stiffness"),
    ("wheels", "pile"): ("carpet", "pile"),
    ("wheels", "roller_friction"): ("drive", "roller_friction"),
    ("commands", "latency_s"): ("radio", "delay_frames"),
    ("commands", "lag_forward_s"): ("control", "lag_s"),
    ("commands", "friction_forward_m_s"): ("control", "drag_m_s"),
    ("commands", "creep_forward_s2_m"): ("control", "creep_s2_m"),
    ("commands", "creep_sideways_s2_m"): ("control", "creep_sideways_s2_m"),
    ("commands", "gain_forward"): ("control", "alpha_forward"),
    ("commands", "gain_sideways"): ("control", "alpha_sideways"),
}
MODEL = "sources/model"  # where `omni_mj.provenance.record` keeps it, too
DRAG = ("pile", "roller_friction")
LEAST = {"radius_m": 0.01, "arm_m": 0.02, "creep_stiffness": 0.1}  # that settings allow; of all else 0


def changes(estimates: Sequence[Estimate], misfits: Container[str] = ()) -> Changes:
    """Return what was identified, as far as the data tell it and settings allow it.

    Args:
        estimates: all there are.
        misfits: sources by which the motion is not what the law predicts, which is said of their numbers.
    """
    made = {}
    drag = [e for e in estimates if e.source == "wheels" and e.name in DRAG]
    drag_is_told = all(e.told for e in drag)  # a log tells the sum of pile and rollers better than each
    for e in estimates:
        place = FIELDS.get((e.source, e.name))
        if place is None or not e.told or e.value < LEAST.get(e.name, 0.0) or (e in drag and not drag_is_told):
            continue
        value, unit, shown = f"{float(f'{e.value:.5g}')}", e.unit, f"{e.value:.4g} +- {e.error:.2g}"
        if place[1] == "delay_frames":
            value, unit = str(round(e.value / PERIOD_S)), "frames"
            shown = f"{e.value / PERIOD_S:.3f} +- {e.error / PERIOD_S:.2g}"
        doubt = "; misfit, see identify.json" * (e.source in misfits)
        made[place] = f"{value} # identified from {e.source}: {shown} {unit}".rstrip() + f" (standard error){doubt}"
    return made


def with_model(model: Path, folder: Path) -> Changes:
    """Copy a model of the user's, with all that it is made of, beside the robot's file that shall name it."""
    try:
        parts = copies(model)
    except (OSError, ValueError):  # parts by absolute paths: it is named where it is
        return {("model", "file"): json.dumps(Path(os.path.relpath(model, folder)).as_posix()) + " # not copied"}
    for place, data in parts.items():
        path = folder / MODEL / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return {("model", "file"): json.dumps(f"{MODEL}/{next(iter(parts))}") + " # copied"}


def written(start: str, made: Mapping[tuple[str, str], str], logs: Sequence[str]) -> str:
    """Return the text of a robot's file with changes; all else, comments included, stays.

    Args:
        start: the start robot's file.
        made: by section and field.
        logs: that they are from, named in the first line.
    """
    present, section = tomllib.loads(start), ""
    lines = [f"# omni-mj identify: numbers marked as identified are from {' '.join(', '.join(logs).split())}"]
    for line in start.splitlines():
        key = re.match(r"\s*([\w-]+)\s*=", line)
        if key and (change := made.get((section, key[1]))):
            line = f"{key[1]} = {change}; was {line.split('#')[0].split('=')[1].strip()}"
        if not line.startswith("#:schema"):
            lines.append(line)
        if head := re.match(r"\s*\[\s*([\w.-]+)\s*\]", line):
            section = head[1]
            lines += [f"{k} = {v}" for (of, k), v in made.items() if of == section and k not in present[section]]
    for name in sorted({of for of, _ in made} - set(present)):
        lines += ["", f"[{name}]", *(f"{key} = {value}" for (of, key), value in made.items() if of == name)]
    return "\n".join([*lines, ""])

"""The start robot's file with identified numbers in place of its own, each with its standard error in a comment."""

import json
import os
import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from omni_mj.mjcf.files import copies
from omni_mj.scenarios.settings import PERIOD_S as FRAME_S
from omni_mj.studies.identify.findings import Estimate


@dataclass(frozen=True)
class Change:
    """A line of a robot's file: its value as TOML has it, and the comment."""

    value: str
    comment: str


# (source, estimate) -> section and field of settings; commands tell what the team's computer believes.
FIELDS = {
    ("wheels", "radius_m"): ("wheels", "radius_m"),
    ("wheels", "arm_m"): ("wheels", "arm_m"),
    ("wheels", "creep_stiffness"): ("drive", "creep_stiffness"),
    ("wheels", "pile"): ("carpet", "pile"),
    ("wheels", "roller_friction"): ("drive", "roller_friction"),
    ("wheels", "grip"): ("carpet", "friction"),
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


def changes(estimates: Sequence[Estimate], misfits: Container[str] = ()) -> dict[tuple[str, str], Change]:
    """Section and field -> what was identified of it; only what the data tell, and settings allow.

    Args:
        estimates: all there are.
        misfits: sources by which the motion is not what the law predicts, which is said of their numbers.
    """
    made = {}
    drag = [e for e in estimates if e.source == "wheels" and e.name in DRAG]
    whole = all(e.told for e in drag)  # a log tells the sum of pile and rollers better than each
    for e in estimates:
        place = FIELDS.get((e.source, e.name))
        if place is None or not e.told or e.value < LEAST.get(e.name, 0.0) or (e in drag and not whole):
            continue
        says = f"identified from {e.source}: {e.value:.4g} +- {e.error:.2g} {e.unit}".rstrip() + " (standard error)"
        value = f"{e.value:.5g}" if "." in f"{e.value:.5g}" or "e" in f"{e.value:.5g}" else f"{e.value:.5g}.0"
        if place[1] == "delay_frames":
            value, frames = str(round(e.value / FRAME_S)), f"{e.value / FRAME_S:.3f} +- {e.error / FRAME_S:.2g}"
            says = f"identified from {e.source}: {frames} frames (standard error)"
        made[place] = Change(value, says + "; misfit, see identify.json" * (e.source in misfits))
    return made


def with_model(model: Path, folder: Path) -> dict[tuple[str, str], Change]:
    """Copy a model of the user's, with all that it is made of, beside the robot's file that shall name it."""
    try:
        parts = copies(model)
    except (OSError, ValueError):  # parts by absolute paths: it is named where it is
        return {("model", "file"): Change(json.dumps(Path(os.path.relpath(model, folder)).as_posix()), "not copied")}
    for place, data in parts.items():
        path = folder / MODEL / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return {("model", "file"): Change(json.dumps(f"{MODEL}/{next(iter(parts))}"), "copied")}


def written(start: str, made: Mapping[tuple[str, str], Change], logs: Sequence[str]) -> str:
    """The text of a robot's file with changes; all else, comments included, stays.

    Args:
        start: the start robot's file.
        made: by section and field.
        logs: that they are from, named in the first line.
    """
    left, lines, section = dict(made), list[str](), ""
    last: dict[str, int] = {}  # section -> its last line that says something
    for line in start.splitlines():
        if head := re.match(r"\s*\[\s*([\w.-]+)\s*\]", line):
            section = head[1]
        key = re.match(r"\s*([\w-]+)\s*=", line)
        if key and (change := left.pop((section, key[1]), None)):
            before = line.split("#")[0].split("=")[1].strip()
            line = f"{key[1]} = {change.value} # {change.comment}; was {before}"
        lines.append(line)
        if line.strip():
            last[section] = len(lines)
    for name in sorted({name for name, _ in left}):
        new = [f"{key} = {change.value} # {change.comment}" for (of, key), change in left.items() if of == name]
        if name in last:
            at = last[name]
            lines[at:at] = new
            last = {other: i + len(new) * (i > at) for other, i in last.items()}
        else:
            lines += ["", f"[{name}]", *new]
    schema = [line for line in lines[:1] if line.startswith("#:schema")]
    files = " ".join(", ".join(logs).split())
    return "\n".join([f"# omni-mj identify: numbers marked as identified are from {files}", *lines[len(schema) :], ""])

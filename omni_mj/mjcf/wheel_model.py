"""Wheels with rollers as plain MJCF, to put on a robot in any MuJoCo scene.

**Shape.** A roller is an ellipsoid of revolution with the radius r and the half-length L. Its
center is at the distance d = R - r from the axle of a wheel of the radius R. Its axis and the axle
enclose the angle g: 90 deg in omni wheels. When the wheel has turned by p since the roller was at
the bottom, the axle is at the height

    h(p) = d cos p + sqrt(r^2 + e sin^2 p),    e = (L^2 - r^2) sin^2 g

above the floor. From h(pi / n) = R, where the next of n rollers takes over, follows L. For many
rollers it is sqrt(R r) in omni wheels.

**Mecanum wheels.** A roller rolls freely across the horizontal projection of its axis, which turns
while the roller passes: the ratio of sideways speed to rim speed is tan g cos p. Its mean is 1 if
tan g = q / sin q with q = pi / n, so g is a little more than 45 deg.

**Contact.** The parameters are chosen: with them, wheels follow their angles within 1 %, and with
stiffer ones or more friction they do not. MuJoCo computes the softness of a contact from the
mobility of the roller, to which the armature contributes.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from string import Template
from typing import Literal

import numpy as np

from omni_mj.config.robot_files import find_models_folder
from omni_mj.config.validation import REQUIRED, SettingsModel, setting

TEMPLATES = Path(__file__).parent / "wheel_files"
DENSITY_KG_M3 = 1000.0  # of a wheel as a solid cylinder
LOAD_RATIO = 5.0  # of the load of a wheel to its mass
MIN_LOAD_RATIO = 1.5
ROLLER_MASS_FRACTION = 1 / 3  # of a wheel
ARMATURE_FRACTION = 0.25  # of the inertia of the load as seen from the axle
BEARING_TIME_CONSTANT_S = 0.2  # of a roller that spins down in the air
GAIN_TIME_CONSTANT_S = 0.01  # of a velocity servo in the air; twice the largest timestep
MAX_ROLLER_RADIUS = 0.45  # relative to the radius of the wheel
MAX_DEVIATION = 0.01  # of the height of the axle from the radius, relative to it
MIN_ROLLERS = {90: 4, 45: 8}  # by angle, even if fewer would be round


class WheelDesign(SettingsModel):
    """Sizes and mass of a wheel with rollers."""

    radius: float = setting(REQUIRED, "radius over the rollers", "m", low=0.015, high=0.5)
    width: float = setting(REQUIRED, "width", "m", low=0.002, high=1)
    rollers: int = setting(REQUIRED, "number of rollers, in all rows", low=4, high=100)
    roller_radius: float = setting(
        REQUIRED, "radius of a roller at its middle", "m", low=0.001, high=0.2
    )
    rows: int = setting(1, "rows of rollers, 1 or 2, staggered by half a pitch", low=1, high=2)
    roller_angle: Literal[90, 45] = setting(
        90, "angle of the rollers to the axle: 90 (omni) or 45 (mecanum)", "deg"
    )
    mass: float = setting(
        0.0, "mass, or 0 for that of a solid cylinder of 1000 kg/m^3", "kg", low=0, high=100
    )
    load: float = setting(
        0.0,
        "mass of the robot per wheel, or 0 for five times that of the wheel",
        "kg",
        low=0,
        high=1000,
    )

    def find_contradictions(self) -> Iterator[str]:
        """Yield a message for the first size that no wheel has."""
        radius, roller_radius = self.radius, self.roller_radius
        if self.rows == 2 and (self.is_mecanum or self.rollers % 2):
            yield "rows must be 1 for mecanum wheels and odd numbers of rollers, not 2"
        elif roller_radius > MAX_ROLLER_RADIUS * radius:
            yield (
                f"roller_radius must be at most {MAX_ROLLER_RADIUS * radius:.4g}, "
                f"{MAX_ROLLER_RADIUS} of radius, not {roller_radius:g}: rollers would overlap "
                "the hub"
            )
        elif self.rollers < (minimum := self.min_rollers):
            yield (
                f"rollers must be at least {minimum} for these radii, not {self.rollers}: the "
                f"gaps would be so wide that the wheel is no circle within {MAX_DEVIATION:.0%}"
            )
        elif self.width < (width := self.roller_width):
            yield (
                f"width must be at least {math.ceil(1e4 * width) / 1e4:g}, that of the rollers, "
                f"not {self.width:g}"
            )
        elif self.nominal_load < MIN_LOAD_RATIO * self.actual_mass:
            yield (
                f"load must be at least {MIN_LOAD_RATIO * self.actual_mass:.3g}, {MIN_LOAD_RATIO} "
                f"times the mass of the wheel, not {self.nominal_load:g}"
            )

    @property
    def is_mecanum(self) -> bool:
        """Whether the rollers are at 45 deg."""
        return self.roller_angle == 45

    @property
    def min_rollers(self) -> int:
        """Smallest number of rollers with which the wheel is round."""
        n = MIN_ROLLERS[self.roller_angle]
        while _measure_deviation(self.radius, self.roller_radius, n) > MAX_DEVIATION:
            n += self.rows
        return n

    @property
    def angle(self) -> float:
        """Angle g between the axis of a roller and the axle, rad."""
        half_pitch = math.pi / self.rollers
        return math.atan2(half_pitch, math.sin(half_pitch)) if self.is_mecanum else math.pi / 2

    @property
    def half_length(self) -> float:
        """Half-length L of a roller, m."""
        e = _compute_excess(self.radius, self.roller_radius, self.rollers)
        return math.sqrt(self.roller_radius**2 + e / math.sin(self.angle) ** 2)

    @property
    def roller_width(self) -> float:
        """Extent of all rows along the axle, m."""
        half_depth = self.roller_radius * math.sin(self.angle)
        return 2 * self.rows * math.hypot(half_depth, self.half_length * math.cos(self.angle))

    @property
    def actual_mass(self) -> float:
        """Mass of the wheel, kg."""
        return self.mass or DENSITY_KG_M3 * math.pi * self.radius**2 * self.width

    @property
    def nominal_load(self) -> float:
        """Mass of the robot per wheel, kg."""
        return self.load or LOAD_RATIO * self.actual_mass

    @property
    def armature(self) -> float:
        """Inertia of motor and gear as seen from the axle, kg m^2."""
        return ARMATURE_FRACTION * self.nominal_load * self.radius**2

    @property
    def inertia(self) -> float:
        """Inertia about the axle with the armature, kg m^2."""
        hub = (1 - ROLLER_MASS_FRACTION) * (self.radius - 2 * self.roller_radius) ** 2 / 2
        rollers = ROLLER_MASS_FRACTION * (self.radius - self.roller_radius) ** 2
        return self.actual_mass * (hub + rollers) + self.armature


def render_wheel_files(design: WheelDesign) -> dict[str, bytes]:
    """Return the contents of a wheel's files by name: MJCF, a scene with a base, and a README."""
    # Name of each model, and sign of the y component of the axis of the roller at the bottom.
    signs = {"left_wheel": -1, "right_wheel": 1} if design.is_mecanum else {"wheel": 0}
    placeholders = _compute_placeholders(design)
    texts = {}
    for model, sign in signs.items():
        rows = "".join(_render_row(design, row, sign) for row in range(design.rows))
        texts[f"{model}.xml"] = _fill("wheel.xml", placeholders, model=model, rows=rows)
    files = "".join(f"| `{name}` | the {name[:-4].replace('_', ' ')} |\n" for name in texts)
    kind = "mecanum" if design.is_mecanum else "omni"
    texts["scene.xml"] = _fill(f"{kind}_scene.xml", placeholders)
    texts["README.md"] = _fill("README.md", placeholders, files=files, kind=kind.title())
    texts["LICENSE"] = (find_models_folder() / "LICENSE").read_text(encoding="utf-8")
    return {name: text.encode() for name, text in texts.items()}


def _fill(template: str, placeholders: dict[str, str], **texts: str) -> str:
    """Return a file of the folder of templates with its placeholders replaced."""
    text = (TEMPLATES / template).read_text(encoding="utf-8")
    return Template(text).substitute(placeholders, **texts)


def _compute_placeholders(design: WheelDesign) -> dict[str, str]:
    """Return the numbers of the files by their names in the templates, SI units, as text."""
    R, r, n = design.radius, design.roller_radius, design.rollers
    roller_mass = ROLLER_MASS_FRACTION * design.actual_mass / n
    roller_inertia = 0.4 * roller_mass * r**2  # of an ellipsoid about its axis
    values = {
        **design.model_dump(),
        "half_width": design.width / 2,
        "angle": math.degrees(design.angle),
        "half_length": design.half_length,
        "hub_radius": R - 2 * r,
        "deviation": 1e3 * R * _measure_deviation(R, r, n),
        "mass": design.actual_mass,
        "load": design.nominal_load,
        "hub_mass": (1 - ROLLER_MASS_FRACTION) * design.actual_mass,
        "roller_mass": roller_mass,
        "damping": roller_inertia / BEARING_TIME_CONSTANT_S,
        "armature": design.armature,
        "inertia": design.inertia,
        "gain": design.inertia / GAIN_TIME_CONSTANT_S,
        "arm": 3 * R,  # of the omni wheels of the base
        "half_track": 2 * R,  # of the mecanum wheels of the base
        "base_half_width": 1.5 * R,
        "base_half_height": 0.4 * R,
        "base_mass": (4 if design.is_mecanum else 3) * (design.nominal_load - design.actual_mass),
        "extent": 7 * R,
    }
    return {name: f"{value:.4g}" for name, value in values.items()}


def _render_row(design: WheelDesign, row: int, sign: int) -> str:
    """Return one row of rollers as MJCF.

    Args:
        design: The wheel.
        row: 0 for the left row, 1 for the right one.
        sign: Sign of the y component of the axis of a roller at the bottom; its x is positive.
    """
    pitch = 360 / design.rollers
    y = (0.5 - row) * (design.rows - 1) * design.width / 2
    axis = f"{math.sin(design.angle):.6g} {sign * math.cos(design.angle):.6g} 0"
    return f"""\
      <frame pos="0 {y:.6g} 0" euler="0 {row * pitch:.9g} 0">
        <replicate count="{design.rollers // design.rows}" euler="0 {design.rows * pitch:.9g} 0">
          <body name="roller_{row}_" pos="0 0 {design.roller_radius - design.radius:.6g}"
                zaxis="{axis}" childclass="roller">
            <joint name="roller_{row}_"/>
            <geom/>
          </body>
        </replicate>
      </frame>
"""


def _compute_excess(radius: float, roller_radius: float, n: int) -> float:
    """Return e, m^2, such that a wheel has the height R where one of n rollers takes over."""
    p = math.pi / n
    length = radius - (radius - roller_radius) * math.cos(p)
    return (length**2 - roller_radius**2) / math.sin(p) ** 2


def _measure_deviation(radius: float, roller_radius: float, n: int) -> float:
    """Return the largest deviation of the axle's height from R, relative to R."""
    p = np.linspace(0, np.pi / n, 50)
    length = np.sqrt(roller_radius**2 + _compute_excess(radius, roller_radius, n) * np.sin(p) ** 2)
    height = (radius - roller_radius) * np.cos(p) + length
    return float(np.abs(height / radius - 1).max())

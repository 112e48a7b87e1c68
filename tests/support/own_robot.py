"""MJCF of a custom robot for tests, with parameters for what users may write differently."""

from collections.abc import Sequence
from math import sqrt

ROLLER_KG = 0.0015
# A tetrahedron of 2 cm, as the content of an OBJ file
MESH = "v 0 0 0\nv 0.02 0 0\nv 0 0.02 0\nv 0 0 0.02\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
WHEEL = """
      <frame euler="0 0 {azimuth}">
        <body name="{name}" pos="{arm} 0 {height}" childclass="wheel">
          <joint name="{name}" axis="{axis} 0 0"/>
          <geom mass="0.044"/>
          <replicate count="{rollers}" euler="{pitch} 0 0">
            <body pos="0 0 -{spoke}" childclass="roller"><joint/><geom/></body>
          </replicate>
        </body>
      </frame>"""
ROBOT = """<mujoco model="mine">
  <compiler autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <visual><map znear="0.2"/></visual>
  <statistic extent="2"/>
  <size memory="10M"/>
  <default>
    <default class="hull"/>
    <default class="wheel"><geom type="cylinder" size="0.018 0.004" euler="0 90 0"/></default>
    <default class="roller">
      <joint axis="0 1 0"/>
      <geom type="ellipsoid" size="{roller} {half} {roller}" mass="{roller_kg}"/>
    </default>
    <dcmotor motorconst="0.0251" resistance="0.464" gear="{gear}" armature="1.35e-5"/>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="base" pos="0.3 -0.2 {base}">
      <freejoint/>
      <geom name="plate" type="cylinder" size="0.08 0.03" pos="0 0 {plate}" mass="{mass}"/>
      <site name="imu"/>{wheels}{more}
    </body>
  </worldbody>
  <actuator>{motors}</actuator>
  <sensor><gyro name="gyro" site="imu"/>{encoders}</sensor>
</mujoco>
"""


def written(
    azimuths: Sequence[float],
    arm: float = 0.08,
    radius: float = 0.0275,
    roller: float = 0.0055,
    rollers: int = 15,
    gear: float = 3.2,
    mass: float = 2.2,
    outward: bool = False,
    raised: float = 0.0,
    more: str = "",
    extra_motors: str = "",
) -> str:
    """An MJCF as somebody may write it who knows MuJoCo and not this program.

    Args:
        azimuths: of the wheels, deg.
        arm, radius, roller: of the wheels and their rollers, m.
        rollers: of a wheel.
        gear: turns of a motor for one of its wheel.
        mass: of all but the wheels, kg.
        outward: whether axes of wheels point away from the robot.
        raised: height of the chassis' frame above the carpet, m.
        more: within the chassis.
        extra_motors: within <actuator>, before the others.
    """
    names = [f"drive_{chr(ord('a') + i)}" for i in range(len(azimuths))]
    wheels = "".join(
        WHEEL.format(
            azimuth=azimuth, name=name, arm=arm, height=radius - raised, axis=1 if outward else -1,
            rollers=rollers, pitch=360 / rollers, spoke=radius - roller,
        )
        for azimuth, name in zip(azimuths, names, strict=True)
    )  # fmt: skip
    return ROBOT.format(
        roller=roller, half=sqrt(radius * roller), roller_kg=ROLLER_KG, gear=gear, base=raised,
        plate=0.05 - raised, mass=mass, wheels=wheels, more=more,
        motors=extra_motors
        + "".join(f'<dcmotor name="m_{name}" joint="{name}"/>' for name in names),
        encoders="".join(f'<jointpos name="e_{name}" joint="{name}"/>' for name in names),
    )  # fmt: skip

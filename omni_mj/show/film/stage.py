"""What a film shows of an instant: robots on their carpet, where they should be, and where they have been."""

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np

from omni_control.errors import OmniError
from omni_control.kinematics import Array
from omni_mj.scenarios.settings import Settings
from omni_mj.show.recording.robot_shape import COVER
from omni_mj.worlds import build, parts

NEEDS = "MuJoCo cannot draw here: {reason}; without a display it needs EGL, on Debian libegl1 and libgl1-mesa-dri"
REFERENCE, ROUTE = (1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 0.6)
RING_M, ABOVE_M = 0.09, 0.15  # radius and height of the league's envelope, at whose top a ring shows the reference
LINE = 0.007  # thickness of what is drawn, as a share of the distance from which it is seen
HEADLIGHT = 0.1  # beside the scene's own light; more, and seen from above a robot's colour is burnt out
GEOMS = 20_000  # at most in a picture; a robot with whole wheels has some 200, a path one for each of its pieces
MARGIN = 0.35  # m around the route, for the robots on it
_CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE


@dataclass(frozen=True)
class View:
    """Where a camera looks from.

    Args:
        azimuth: of the direction in which it looks, deg from x.
        elevation: of that direction, deg; -90 is straight down.
        distance: from what it looks at, m; None to have the whole route in sight.
    """

    azimuth: float
    elevation: float
    distance: float | None


VIEWS = {
    "follow": View(90.0, -38.0, 0.85),
    "whole": View(90.0, -55.0, None),
    "plan": View(90.0, -90.0, None),
}


class Stage:
    """Draws the robots of one world.

    Args:
        settings: of the robots.
        places: number of robots.
        view: name of one of `VIEWS`.
        route: where all references go, (m, 2) m.
        size: width and height of a picture, pixels.

    Raises:
        OmniError: MuJoCo finds nothing to draw with.
    """

    def __init__(self, settings: Settings, places: int, view: str, route: Array, size: tuple[int, int]) -> None:
        world = build.world(settings.replace(wheels={"model": "rollers"}), places, hulls=False)
        self._world, self._model, self._data = world, world.model, mujoco.MjData(world.model)
        width, height = size
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        quality = self._model.vis.quality  # of a software renderer: time goes with the facets of some 80 rollers
        quality.numslices, quality.numstacks, quality.shadowsize = 20, 8, 1024
        self._model.vis.headlight.diffuse[:] = HEADLIGHT
        try:
            self._renderer = mujoco.Renderer(self._model, height, width, GEOMS)
        except Exception as error:  # whatever the platform's GL raises
            raise OmniError(NEEDS.format(reason=error or type(error).__name__)) from None
        self._view, self._camera = VIEWS[view], mujoco.MjvCamera()
        low, high = route.min(0) - MARGIN, route.max(0) + MARGIN
        self._centre = (low + high) / 2
        # The whole route is in sight from where its height and, less by the picture's shape, its width are.
        half = np.tan(np.deg2rad(self._model.vis.global_.fovy / 2))
        self._reach = float(half * min(width / height, 1.0))  # in sight to either side, as a share of the distance
        distance = float(max(high[1] - low[1], (high[0] - low[0]) * height / width) / 2 / half)
        self._distance = self._view.distance or distance
        self._thick = LINE * self._distance

    def draw(
        self,
        poses: Array,
        wheels: Array,
        references: Array,
        trails: list[Array],
        routes: list[Array],
        colour: tuple[float, float, float],
    ) -> np.ndarray:
        """Return a picture, (height, width, 3) bytes.

        Args:
            poses: of the robots, (places, 3) m, m, rad.
            wheels: their wheels' angles, (places, wheels) rad.
            references: poses in which they should be, (places, 3).
            trails: where each has been, (m, 2) m.
            routes: where each reference goes, (m, 2) m.
            colour: of covers and trails, red, green, blue from 0 to 1.
        """
        self._pose(poses, wheels)
        self._paint(colour)
        near, distance = self._centre, self._distance
        if self._view.distance:  # robots and where they should be, which may be far apart
            seen = np.concatenate([references[:, :2], poses[:, :2]])
            near = seen.mean(0)
            distance = max(distance, (np.hypot(*(seen - near).T).max() + 2 * RING_M) / self._reach)
        self._camera.lookat[:] = *near, 0.05
        self._camera.azimuth, self._camera.elevation = self._view.azimuth, self._view.elevation
        self._camera.distance = distance
        self._renderer.update_scene(self._data, self._camera)
        for route in routes:
            self._line(route, ROUTE)
        for trail in trails:
            self._line(trail, (*colour, 1.0))
        for x, y, heading in references:
            turns = heading + np.linspace(0, 2 * np.pi, 25)
            ring = np.array([x, y]) + RING_M * np.column_stack([np.cos(turns), np.sin(turns)])
            self._line(ring, REFERENCE, ABOVE_M)
            self._line(np.array([[x, y], ring[0]]), REFERENCE, ABOVE_M)
        return np.array(self._renderer.render())

    def close(self) -> None:
        """Let go of what draws."""
        self._renderer.close()

    def _pose(self, poses: Array, wheels: Array) -> None:
        data, standing = self._data, self._world.standing
        data.qpos[:] = standing
        for robot, (x, y, heading), angles in zip(self._world.robots, poses, wheels, strict=True):
            data.qpos[robot.qpos[:2]] = x, y
            data.qpos[robot.qpos[3:7]] = np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)
            data.qpos[robot.wheel_qpos] = angles
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_camlight(self._model, data)

    def _paint(self, colour: tuple[float, float, float]) -> None:
        for place in range(len(self._world.robots)):
            cover = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_MATERIAL, parts.prefix(place) + COVER)
            if cover >= 0:
                self._model.mat_rgba[cover, :3] = colour

    def _line(self, points: Array, rgba: tuple[float, ...], height: float | None = None) -> None:
        """Draw a line through points (m, 2), at a height in m; on the carpet if none is said."""
        above = np.full(len(points), self._thick / 2 if height is None else height)
        scene, line = self._renderer.scene, np.column_stack([points, above])
        for start, end in pairwise(line):
            if scene.ngeom < scene.maxgeom:
                geom, none = scene.geoms[scene.ngeom], np.zeros(3)
                mujoco.mjv_initGeom(geom, _CAPSULE, none, none, np.eye(3).ravel(), np.array(rgba, np.float32))
                mujoco.mjv_connector(geom, _CAPSULE, self._thick / 2, start, end)
                scene.ngeom += 1

"""3-D view of the page: field, robots, references, predicted poses, enlarged position errors."""

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import trimesh

from omni_control.kinematics import Array
from omni_mj.config import faults
from omni_mj.mjcf import field
from omni_mj.mjcf.field import ROBOT_HEIGHT_M, ROBOT_RADIUS_M
from omni_mj.viz import style
from omni_mj.viz.recording import robot_shapes, scene

if TYPE_CHECKING:
    from omni_mj.config.settings import Settings
    from omni_mj.config.world_settings import WorldSettings
    from omni_mj.play.play_session import PlaySession, Snapshot

HIDDEN = (0.0, 0.0, -10.0)  # position of something that has none, below the field
DEBRIS_COLOR = (140, 110, 70)
TRAIL_LENGTH = 240  # updates of the view
FLAG_HEIGHT_M = ROBOT_HEIGHT_M + 0.05  # of the lowest error arrow
# MuJoCo geom type -> mesh of its sizes.
MESHES: dict[str, Any] = {
    "CYLINDER": lambda size: trimesh.creation.cylinder(size[0], 2 * size[1], sections=24),
    "CAPSULE": lambda size: trimesh.creation.capsule(2 * size[1], size[0], count=(8, 8)),
    "BOX": lambda size: trimesh.creation.box(2 * size),
    "ELLIPSOID": lambda size: trimesh.creation.icosphere(1).apply_scale(size),
    "SPHERE": lambda size: trimesh.creation.icosphere(1, size[0]),
}


class FieldView:
    """Robots on a field.

    Args:
        api: viser's scene of the page.
        session: Session with n robots.
    """

    def __init__(self, api: Any, session: "PlaySession") -> None:
        simulation, self._labels = session.simulation, session.labels
        paths = [reference.poses for reference in simulation.references]
        self._api, self._session = api, session
        self._shown_snapshot: Snapshot | None = None
        self._debris = list[faults.FrictionPatch]()
        self._discs = list[Any]()
        self.center, self.size_m = scene.measure_scene(paths)
        self._trails = np.repeat(session.snapshot.pose[None, :, :2], TRAIL_LENGTH, axis=0)
        api.reset()
        api.configure_environment_map(None)
        api.configure_default_lights(cast_shadow=False)
        _add_field(api, session.scenario.settings.world)
        for i, path in enumerate({path.tobytes(): path for path in paths}.values()):
            _add_path(api, f"/reference/{i}", path, scene.REFERENCE_COLOR, 0.015)
        self._robots, self._ghosts, self._targets, self._names = [], [], [], []
        self._paths = []
        for i, (label, color) in enumerate(zip(session.labels, session.colors, strict=True)):
            mesh = build_robot_mesh(simulation.rows[i].settings, color)
            self._robots.append(api.add_mesh_trimesh(f"/robot/{i}", mesh))
            ghost = api.add_cylinder(
                f"/predicted/{i}", ROBOT_RADIUS_M, ROBOT_HEIGHT_M, color=color, opacity=0.3
            )
            self._ghosts.append(ghost)
            target = api.add_icosphere(f"/target/{i}", 0.025, color=scene.REFERENCE_COLOR)
            self._targets.append(target)
            self._names.append(api.add_label(f"/name/{i}", label, anchor="bottom-center"))
            trail = _add_path(api, f"/trail/{i}", self._trails[:, i], color, 0.025)
            self._paths.append(trail)
        self._arrows = api.add_arrows(
            "/error",
            self._tips(session.snapshot),
            np.array(session.colors),
            shaft_radius=0.01,
            head_radius=0.03,
            head_length=0.06,
        )

    def update(self, snapshot: "Snapshot") -> None:
        """Show a snapshot."""
        previous, self._shown_snapshot = self._shown_snapshot, snapshot
        if snapshot is previous:  # paused
            return
        tips, pose = self._tips(snapshot), snapshot.pose
        if previous and snapshot.time_s < previous.time_s:  # a restart
            self._trails[:] = pose[:, :2]
        self._trails = np.concatenate([self._trails[1:], pose[None, :, :2]])
        for i, (x, y, heading) in enumerate(pose):
            self._robots[i].position = (x, y, i * scene.LAYER_M)
            self._robots[i].wxyz = (np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2))
            predicted = (*snapshot.predicted[i, :2], ROBOT_HEIGHT_M / 2)
            self._ghosts[i].position = _visible_position(predicted)
            self._targets[i].position = _visible_position((*snapshot.reference[i, :2], 0.01))
            self._names[i].position = tips[i, 1] + (0, 0, 0.03)
            cm = 100 * snapshot.error_m[i]
            self._names[i].text = self._labels[i] + (f"  {cm:.1f} cm" if np.isfinite(cm) else "")
        debris = self._session.list_faults(faults.FrictionPatch)
        if debris != self._debris:
            self._show_debris(debris)
        self._arrows.points = np.float32(tips)
        for path, trail in zip(self._paths, self._trails.swapaxes(0, 1), strict=True):
            path.points = _join(trail)

    def _show_debris(self, debris: list[faults.FrictionPatch]) -> None:
        """Show debris as discs."""
        for disc in self._discs:
            disc.remove()
        self._debris = debris
        self._discs = [
            self._api.add_cylinder(
                f"/debris/{i}",
                patch.radius_m,
                0.002,
                color=DEBRIS_COLOR,
                position=(patch.x_m, patch.y_m, 0.0),
            )
            for i, patch in enumerate(debris)
        ]

    def _tips(self, snapshot: "Snapshot") -> Array:
        """Return the ends of the error arrows, (n, 2, 3) m, enlarged, at different heights."""
        pose, reference = snapshot.pose[:, :2], snapshot.reference[:, :2]
        start = np.where(np.isfinite(reference), reference, pose)
        heights = FLAG_HEIGHT_M + scene.FLAG_STEP * self.size_m * np.arange(len(pose))
        ends = [start, start + scene.ERROR_SCALE * (pose - start)]
        return np.stack([np.column_stack([end, heights]) for end in ends], axis=1)


def build_robot_mesh(settings: "Settings", cover_color: style.Rgb) -> Any:
    """Return the visible shapes of a robot that stands at the origin, as one mesh."""
    world, data = robot_shapes.stand_at_origin(settings)
    model, colors = world.model, robot_shapes.geom_colors(world, cover_color)
    bodies = np.flatnonzero(model.body_rootid == world.robots[0].chassis)
    geom_meshes = []
    for geom in np.flatnonzero(robot_shapes.are_visible(model, bodies)).tolist():
        name = mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_")
        if name == "MESH":
            corners = robot_shapes.mesh_triangles(model, geom).reshape(-1, 3)
            triangles = np.arange(len(corners)).reshape(-1, 3)
            mesh_i: Any = trimesh.Trimesh(corners, triangles, process=False)
        else:
            mesh_i = MESHES[name](model.geom_size[geom])
        transform = np.eye(4)
        transform[:3, :3] = data.geom_xmat[geom].reshape(3, 3)
        transform[:3, 3] = data.geom_xpos[geom]
        mesh_i.apply_transform(transform)
        mesh_i.unmerge_vertices()  # flat shading
        mesh_i.visual.vertex_colors = np.tile([*colors[geom], 255], (len(mesh_i.vertices), 1))
        geom_meshes.append(mesh_i)
    return trimesh.util.concatenate(geom_meshes)


def _add_field(api: Any, world: "WorldSettings") -> None:
    """Add carpet, lines and goals."""
    length, width = world.carpet_size_m
    api.add_box(
        "/carpet",
        dimensions=(length, width, 0.02),
        position=(0, 0, -0.0115),
        color=scene.CARPET_COLOR,
    )
    for i, line in enumerate(scene.field_line_strips(world)):
        _add_path(api, f"/line/{i}", line, scene.LINE_COLOR, field.LINE_WIDTH_M)
    for i, (center, half_size) in enumerate(zip(*field.get_goal_walls(world), strict=True)):
        api.add_box(f"/goal/{i}", dimensions=2 * half_size, position=center, color=scene.GOAL_COLOR)


def _add_path(api: Any, name: str, points: Array, color: Any, width_m: float) -> Any:
    """Add a line through points, (n, 2 or more) m, on the carpet."""
    return api.add_line_segments(name, _join(points), np.array(color), thickness=width_m)


def _join(points: Array) -> np.ndarray:
    """Return the segments between successive points, (n - 1, 2, 3) m, just above the carpet."""
    corners = robot_shapes.points_above(points, scene.REFERENCE_HEIGHT_M)
    return np.stack([corners[:-1], corners[1:]], axis=1, dtype=np.float32)


def _visible_position(position: Any) -> Any:
    """Return a position, or one below the field if it is unknown (NaN)."""
    return position if np.isfinite(position).all() else HIDDEN

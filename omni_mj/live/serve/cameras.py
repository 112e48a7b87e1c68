"""The cameras of `serve`: each takes images by a clock of its own, sees part of the field, and sends what it saw."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omni_control.kinematics import Array
from omni_mj.link.camera import Camera, Timing
from omni_mj.link.noise import Noise, Seed, Stream
from omni_mj.live.serve.field import Area
from omni_mj.live.wire.simulation import Team
from omni_mj.live.wire.vision import DetectedBall, DetectedRobot, Detection
from omni_mj.scenarios.rows import Row
from omni_mj.scenarios.settings import CYCLE_RATE_HZ, FRAME_RATE_HZ

CYCLES = CYCLE_RATE_HZ // FRAME_RATE_HZ  # in a frame
Name = tuple[Team, int]  # of a robot
APART = 1000  # added to a camera's number, to tell its seeds from those of places


@dataclass(frozen=True)
class Image:
    """What a camera saw.

    Args:
        camera: its number.
        frame: number of the image.
        cycle: in which it was taken.
        names: of the robots at that time.
        poses: measured (n, 3), not a number where a robot was not seen.
        ball: measured, m, or None.
        sent: when it is sent, s of simulated time; never, if it is lost, is infinite.
        behind: by how much its camera's clock is behind itself, s.
    """

    camera: int
    frame: int
    cycle: int
    names: tuple[Name, ...]
    poses: Array
    ball: tuple[float, float] | None
    sent: float
    behind: float


class Eye:
    """One camera.

    The first one's images are at the cycles 0, 1/rate, ..., and its noise is that which the loop of `run` has; the
    others begin anywhere within their first period and have noise of their own.

    Args:
        number: of the camera, from 0.
        rows: of the robots; what concerns the camera as a whole is that of the first.

    Attributes:
        due: cycle of the next image.
    """

    def __init__(self, number: int, rows: Sequence[Row]) -> None:
        self._number, self._vision = number, rows[0].settings.vision
        self.watch(rows)
        own: list[Seed] = [(rows[0].seed, APART + number)]
        self._timing = Timing([self._vision], own, [rows[0].faults])
        self._ball = Noise(own, Stream.VISION_NOISE, lambda rng, count: rng.standard_normal((count, 2)))
        drawn = Noise(own, Stream.CAMERA_CLOCK, lambda rng, count: rng.standard_normal((count, 4))).next()[0]
        self._offset = self._vision.camera_offset_m * np.array([*drawn[:2], 0.0])
        self.clock_offset = self._vision.clock_offset_s * float(drawn[2])
        anywhere = float(drawn[3] * 1e3 % 1.0)  # of a period: of so wide a normal number the fraction is uniform
        self._phase = 0.0 if number == 0 else anywhere / self._vision.rate_hz
        self._frame = 0
        self.due = self._cycle_of(0)

    def watch(self, rows: Sequence[Row]) -> None:
        """Have these robots in view from now on, in place of those before."""
        seeds = [row.noise_seed if self._number == 0 else (*row.noise_seed, APART + self._number) for row in rows]
        self._camera = Camera([row.settings.vision for row in rows], seeds, [row.faults for row in rows])

    def look(
        self,
        cycle: int,
        names: Sequence[Name],
        poses: Array,
        present: np.ndarray,
        ball: Array | None,
        area: Area,
    ) -> Image:
        """Take the image that is due.

        Args:
            cycle: which it is.
            names: of the robots, n.
            poses: true, (n, 3).
            present: which robots are on the field, (n,).
            ball: where it is, (2,) m, if there is one.
            area: what the camera sees.
        """
        measured, _ = self._camera(poses, cycle // CYCLES)
        hidden = ~(present & area.sees(poses[:, :2]))
        if np.count_nonzero(hidden):
            measured[hidden] = np.nan
        vision, frame, noise = self._vision, self._frame, self._ball.next()[0].tolist()
        (sent,), (behind,) = self._timing.at(cycle // CYCLES, cycle / CYCLE_RATE_HZ)
        self._frame += 1
        self.due = self._cycle_of(self._frame)
        where = None
        if ball is not None and area.covers(x := float(ball[0]), y := float(ball[1])):
            sigma, (aside_x, aside_y, _) = vision.position_noise_m, self._offset.tolist()
            where = x + noise[0] * sigma + aside_x, y + noise[1] * sigma + aside_y
        return Image(
            self._number, frame, cycle, tuple(names), measured + self._offset, where, float(sent), float(behind)
        )

    def _cycle_of(self, frame: int) -> int:
        """The first cycle that is not before an image is taken."""
        return math.ceil((frame / self._vision.rate_hz + self._phase) * CYCLE_RATE_HZ - 1e-6)


def detection(image: Image, area: Area, clock: float, height: float) -> Detection:
    """What is sent of an image.

    Args:
        image: what was seen.
        area: of its camera.
        clock: what the camera's clock shows at the simulated time 0, s.
        height: of robots, m.
    """
    teams: tuple[list[DetectedRobot], list[DetectedRobot]] = [], []
    for (team, number), (x, y, heading) in zip(image.names, image.poses.tolist(), strict=True):
        if not math.isnan(x):
            teams[team == Team.BLUE].append(DetectedRobot(number, x, y, heading, 1.0, *area.pixel(x, y), height))
    ball = () if image.ball is None else (_ball(*image.ball, area),)
    captured = clock + image.cycle / CYCLE_RATE_HZ
    yellow, blue_ones = (tuple(sorted(team)) for team in teams)
    return Detection(image.frame, captured, clock + image.sent, image.camera, ball, yellow, blue_ones, captured)


def _ball(x: float, y: float, area: Area) -> DetectedBall:
    pixel_x, pixel_y = area.pixel(x, y)
    return DetectedBall(x, y, pixel_x=pixel_x, pixel_y=pixel_y)

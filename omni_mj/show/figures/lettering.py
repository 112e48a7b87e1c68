"""Text of PNGs: a line is laid out once and kept as a picture, however often and in however many figures it stands.

Matplotlib lays out each line twice and then draws it letter by letter, which would be most of the work of a figure.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg, get_hinting_flag
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.ft2font import LoadFlags
from matplotlib.text import Text
from PIL import Image

Gc = Any  # of matplotlib: colour, clipping
KEPT = 4096  # lines
SUBPIXELS = 64  # FreeType's, of a pixel


class Line(NamedTuple):
    """A line of text: its width, height and depth below the baseline in pixels, and the picture of it.

    That is the ink (rows, columns), 0 to 255, with `above` rows over the baseline, `left` pixels from where it begins.
    """

    size: tuple[float, float, float]
    ink: np.ndarray
    above: int
    left: float


def picture(figure: Figure) -> Image.Image:
    """A figure as a picture, without the transparency that none has."""
    canvas = Canvas(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]


class Canvas(FigureCanvasAgg):
    """Agg's canvas with a `Renderer`, for one picture."""

    renderer: "Renderer"

    def get_renderer(self) -> "Renderer":
        """The one renderer of the figure, which is as large now as it will be drawn."""
        if "renderer" not in vars(self):
            self.renderer = Renderer(*self.figure.bbox.size, self.figure.dpi)  # type: ignore[no-untyped-call]
        return self.renderer


class Renderer(RendererAgg):
    """Agg's renderer that draws lines of text, level or upright, as the pictures that are kept of them."""

    def get_text_width_height_descent(
        self, s: str, prop: FontProperties, ismath: bool | str
    ) -> tuple[float, float, float]:
        """Width, height and what is below the baseline of a line of text, pixels."""
        if ismath:
            return super().get_text_width_height_descent(s, prop, ismath)  # type: ignore[no-untyped-call]
        return self._line(s, prop).size

    def draw_text(
        self, gc: Gc, x: float, y: float, s: str, prop: FontProperties, angle: float, ismath: bool | str = False,
        mtext: Text | None = None,
    ) -> None:  # fmt: skip
        """Draw a line whose baseline begins at x from the left and y from the top, pixels."""
        if ismath or angle not in (0, 90):
            super().draw_text(gc, x, y, s, prop, angle, ismath, mtext)  # type: ignore[no-untyped-call]
            return
        line = self._line(s, prop)
        y = self.height - y  # from below
        if angle:
            ink, x, y = np.rot90(line.ink), round(x) - line.above, y + line.left
        else:
            ink, x, y = line.ink, x + line.left, round(y) - (len(line.ink) - line.above)
        *colour, opaque = gc.get_rgb()
        image = np.empty((*ink.shape, 4), np.uint8)
        image[..., :3] = np.rint(255 * np.array(colour))
        image[..., 3] = np.rint(opaque * ink)
        self.draw_image(gc, round(x), round(y), image[::-1])

    def _line(self, text: str, font: FontProperties) -> Line:
        hints: LoadFlags = get_hinting_flag()  # type: ignore[no-untyped-call]
        return _laid_out(text, findfont(font), font.get_size_in_points(), self.dpi, hints)


@lru_cache(KEPT)
def _laid_out(text: str, path: str, points: float, dpi: float, hints: LoadFlags) -> Line:
    """A line of text in the font of a file."""
    font = get_font(path)
    font.set_size(points, dpi)
    font.set_text(text, 0.0, flags=hints)
    font.draw_glyphs_to_bitmap(antialiased=True)
    width, height = font.get_width_height()
    deep, left = font.get_descent(), font.get_bitmap_offset()[0]
    above = (height - deep) // SUBPIXELS + 1  # of the two rows that FreeType's picture has more than the text, one
    return Line(
        (width / SUBPIXELS, height / SUBPIXELS, deep / SUBPIXELS), np.array(font.get_image()), above, left / SUBPIXELS
    )

"""Files that films are written to: GIF and WebP by Pillow; MP4 and WebM by PyAV, an extra."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from PIL import Image

from omni_control.errors import OmniError
from omni_mj.files import whole

KINDS = (".gif", ".webp", ".mp4", ".webm")
_CODECS = {".mp4": "libx264", ".webm": "libvpx-vp9"}
COLOURS = 128  # of a GIF, one palette for all pictures, so that what rests does not flicker


def write(pictures: Iterable[Image.Image], out: Path, rate: float) -> None:
    """Write pictures of one size to a file of a kind of `KINDS`, `rate` of them a second.

    Raises:
        OmniError: a video is asked for and PyAV is not installed, or the file cannot be written.
    """
    try:
        with whole(out) as file:
            (_video if out.suffix in _CODECS else _animation)(pictures, file, out.suffix, rate)
    except OSError as error:
        raise OmniError(f"{out}: {error.strerror or error}") from None


def check(out: Path) -> None:
    """See that a film can be written to a file.

    Raises:
        OmniError: it is of no kind that can be written, or of one for which PyAV is missing.
    """
    if out.suffix not in KINDS:
        raise OmniError(f"{out}: a film's name ends in {', '.join(KINDS)}")
    if out.suffix in _CODECS:
        try:
            import av  # noqa: F401
        except ImportError:
            raise OmniError(f"{out}: videos need PyAV: pip install 'omni-mj[film]'; .gif and .webp do not") from None


def _animation(pictures: Iterable[Image.Image], file: BinaryIO, kind: str, rate: float) -> None:
    every = list(pictures)
    if kind == ".gif":
        few = every[:: max(1, len(every) // 8)]  # what the palette is made of
        strip = Image.new("RGB", (few[0].width, few[0].height * len(few)))
        for i, picture in enumerate(few):
            strip.paste(picture, (0, i * picture.height))
        palette = strip.quantize(COLOURS, dither=Image.Dither.NONE)
        every = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in every]
    options: dict[str, Any] = {"quality": 60, "method": 4} if kind == ".webp" else {"optimize": False}
    options |= {"format": kind[1:], "save_all": True, "append_images": every[1:], "loop": 0}
    every[0].save(file, duration=round(1000 / rate), **options)


def _video(pictures: Iterable[Image.Image], file: BinaryIO, kind: str, rate: float) -> None:
    import av

    with av.open(file, "w", format=kind[1:]) as container:
        stream: Any = None
        for picture in pictures:
            if stream is None:
                stream = container.add_stream(_CODECS[kind], rate=Fraction(rate).limit_denominator(1000))
                stream.width, stream.height = picture.width // 2 * 2, picture.height // 2 * 2
                stream.pix_fmt = "yuv420p"
            even = np.asarray(picture)[: stream.height, : stream.width]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")))
        if stream is not None:
            container.mux(stream.encode())

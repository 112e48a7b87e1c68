"""What `serve` tells people when it begins and ends."""

import numpy as np

from omni_mj.live.serve.pitch import label
from omni_mj.live.serve.server import Server


def begins(server: Server) -> str:
    """Who is served where, in a line each."""
    pitch, (control, blue, yellow) = server.pitch, server.ports
    settings = pitch.rows[0].settings
    lines = [
        f"serving {', '.join(map(label, pitch.names))}: {', '.join(dict.fromkeys(row.robot for row in pitch.rows))}",
        f"  ports      simulator {control}, blue {blue}, yellow {yellow}; vision to {server.publisher.to}",
        f"  cameras    {settings.vision.cameras} of {settings.vision.rate_hz:g} Hz, {server.time_goes}",
        f"  dead time  {settings.radio.delay_frames} frames of 1/60 s (radio.delay_frames); "
        + (
            f"robots stop {settings.firmware.timeout_s:g} s after"
            if settings.firmware.timeout_s
            else "robots never forget"
        )
        + " the last command (firmware.timeout_s)",
    ]
    return "\n".join(lines)


def ends(server: Server) -> str:
    """What came and went, in a line each."""
    lines = [f"{server.pitch.time_s:.1f} s simulated"]
    lines += [f"  {count:8d}  {kind}" for kind, count in sorted((server.counts + server.notes.counts).items())]
    if server.lost_s:
        lines.append(f"  {server.lost_s:8.1f}  s behind, in which this computer was too slow")
    late = np.array(server.publisher.lateness)
    if late.size and np.isfinite(late).all() and server.in_real_time:
        shares = ", ".join(f"{1e3 * np.quantile(late, q):.2f} ({q:.0%})" for q in (0.05, 0.5, 0.95, 0.99))
        lines.append(f"  detections left {shares}, {1e3 * late.max():.2f} ms (most) after they were due")
    return "\n".join(lines)

"""Recordings of runs for the rerun viewer: a file, or a viewer that is fed, while the run goes on."""

import os

# rerun's log would break into lines of our own; what matters in it comes back as an exception.
os.environ.setdefault("RUST_LOG", "off")

from omni_mj.show.recording.stream import Recording

__all__ = ["Recording"]

"""Scenarios: what is run, with every setting, its unit, range and meaning."""

# The clock of everything: the camera's frames, and the cycles of the physics in them.
FRAME_RATE_HZ = 60  # SSL-Vision's cameras (paper, section 4)
PERIOD_S = 1 / FRAME_RATE_HZ
CYCLE_RATE_HZ = 960  # at which wheel loops run unless they are slower: 16 cycles a frame

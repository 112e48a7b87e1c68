"""Scenarios and their settings: TOML files, defaults, units, ranges, meanings and validation."""

FRAME_RATE_HZ = 60  # of cameras and controllers (paper, section 4)
PERIOD_S = 1 / FRAME_RATE_HZ
CYCLE_RATE_HZ = 960  # of the physics, and of wheel loops by default: 16 cycles per frame
CYCLES_PER_FRAME = CYCLE_RATE_HZ // FRAME_RATE_HZ

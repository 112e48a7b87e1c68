"""The clock of everything: the camera's frames."""

FRAME_RATE_HZ = 60  # SSL-Vision's cameras (paper, section 4)
PERIOD_S = 1 / FRAME_RATE_HZ

"""The slip study: gain, slip and drag of robots, identified as TIGERs Mannheim do."""

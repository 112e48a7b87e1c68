"""A simulator of the league: our physics behind its protocols."""

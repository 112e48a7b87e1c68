"""`omni-mj serve`: a simulator of the league."""

"""`omni-mj serve`: a simulator with the network protocols of the league."""

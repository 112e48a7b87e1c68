"""A cycle of bodies and wheels: one implicit step of the law of creep, with wheels that hold, creep or slide."""

"""A Mamdani inference engine with an exact centre of gravity, and the paper's rules on it."""

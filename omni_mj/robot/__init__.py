"""Equations of a robot on carpet, as pure functions of arrays, which run under numpy or JAX.

Names that all modules share: `p` are parameters, `s` is the state, W the number of wheels, n the
number of robots, and `xp` the namespace of the arrays.
"""

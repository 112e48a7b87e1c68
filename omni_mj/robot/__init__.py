"""Equations of a robot on carpet, as pure functions of arrays, which run under numpy or JAX.

Names in all modules: `p` are the parameters, `s` is the state, `xp` the namespace of the arrays
(numpy or jax.numpy), W the number of wheels, and n the number of robots.
"""

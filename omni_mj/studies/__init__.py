"""Studies: simulations that answer one question, with a result, a table and a figure.

- `run_scenario`: one scenario with all its controllers, and parts that all studies use
- `open_loop`: parts of studies whose robots are sent twists, without a controller
- `compare_study`: the same controllers and seeds on many scenarios
- `sweep`: one scenario under many settings and seeds
- `limit`: the least error that is possible on a plant
- `loop`: step response and stability margins of control loops
- `alpha`: how closely robots follow velocity commands, and why
- `slip`: gain, slip and drag of robots, as TIGERs Mannheim identify them
- `identify`: parameters of a user's robot from its logs
"""

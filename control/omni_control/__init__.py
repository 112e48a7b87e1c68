"""Control of four-wheeled omnidirectional robots: kinematics, reference, fuzzy tracking, delay compensation.

Needs numpy and scipy only and knows neither a simulator nor files, so that it could run on a team's own computer
unchanged. All arrays have a leading axis of robots.
"""

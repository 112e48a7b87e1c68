"""Identification of a user's robot from its logs.

`logs` reads them, `axes` checks that they are of one robot's motion, `segments` cuts them, `law` predicts them, `fit`
is the least squares, `findings` says what the data tell and what not, `study` is all of it, `plan` what to drive.
"""



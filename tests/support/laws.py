"""How often the tests of control state a law: the same examples in each run."""

from hypothesis import settings

LAW = settings(deadline=None, max_examples=30, derandomize=True)
FEW = settings(LAW, max_examples=12)  # for a law whose every example is a drive
FEWER = settings(LAW, max_examples=5)  # and for one whose example takes half a second

"""Test benches: the only modules of the tests that import the program's internal names.

A test imports `omni_mj` (the public API), `omni_control`, the command line, or a bench from here. Each file is one
bench (a motor, a plant, a camera ...) with a small interface in the terms of physics, so that a redesign changes this
folder and no test.
"""

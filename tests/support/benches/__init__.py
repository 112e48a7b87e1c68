"""Test benches: the only test modules that import internal names of the program.

A test imports `omni_mj` (the public API), `omni_control`, the command line, or a bench from here.
Each file is one bench (a motor, a plant, a camera ...) with a small interface in physical terms, so
that a redesign changes this folder and no test.
"""

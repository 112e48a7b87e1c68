"""Equations of a robot on carpet, as pure functions of arrays: firmware, motors, battery, drag and creep."""

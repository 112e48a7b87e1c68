"""Controllers: the base class, the paper's controllers, and those that they are compared with."""

"""Controllers: the base class, the paper's controllers, and controllers for comparison."""

"""Robots that drive live while settings change, and the page that shows them (`omni-mj play`)."""

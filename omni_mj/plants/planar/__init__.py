"""The plant for large numbers: robots in the plane, without a contact solver (docs/planar.md)."""

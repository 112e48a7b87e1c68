"""What a run's folder says it ran, and whether it gives the same again."""

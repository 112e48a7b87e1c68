"""Tables, figures, reports, recordings for the rerun viewer, and films of runs."""

"""What came out of a simulation: errors, statistics over seeds, events, verdicts, and the result that holds them."""

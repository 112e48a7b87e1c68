"""Results of simulations: errors, statistics over seeds, events, verdicts, summaries, files."""

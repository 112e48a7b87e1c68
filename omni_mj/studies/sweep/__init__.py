"""The sweep: one scenario under many settings and seeds, in shards that survive a kill."""

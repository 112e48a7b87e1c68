"""The sweep: one scenario under many settings and seeds, saved shard by shard."""

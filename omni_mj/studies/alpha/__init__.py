"""The alpha study: how far and how late robots follow their commands, and why."""

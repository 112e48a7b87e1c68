"""The alpha study: gain and lag of robots that follow velocity commands, and their causes."""

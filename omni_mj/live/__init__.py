"""The league's protocols: a team that drives anybody's robots, and robots that anybody's team drives."""

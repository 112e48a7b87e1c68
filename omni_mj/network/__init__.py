"""Link between robots and the team's computer: cameras, radio, their faults, random numbers."""

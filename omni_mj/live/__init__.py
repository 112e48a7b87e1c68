"""The league's protocols: `drive` commands external robots, `serve` simulates robots for others."""

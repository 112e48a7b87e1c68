"""Studies: what is run to learn something; each gives a `Result`."""

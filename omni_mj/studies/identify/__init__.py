"""Identification of a user's robot from its logs."""

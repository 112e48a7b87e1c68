"""The one base class of errors that a user can cause."""


class OmniError(ValueError):
    """What a user gave, or asked for, cannot be: the message says what, why, and what is allowed."""

"""The errors that a person sees as one sentence; every other exception is a bug and shows its traceback."""


class AcrcError(Exception):
    """What is wrong, where, with which value, and what would have been right: one sentence."""

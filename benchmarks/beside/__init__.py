"""This state of the project and another one in turn: how much faster it is, with intervals."""

"""Damaged bytes for every parser of bytes from outside: each must answer with a sentence."""

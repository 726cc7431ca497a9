"""The model problem: autonomous cleaning robots that visit places and get into one another's way."""

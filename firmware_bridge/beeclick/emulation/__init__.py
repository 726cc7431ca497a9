"""Boards that are not there: the firmware's side of the wire, over an emulated medium."""

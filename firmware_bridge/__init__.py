"""Drivers and emulators of robot hardware: radio board, base, range sensors."""

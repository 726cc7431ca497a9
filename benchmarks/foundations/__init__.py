"""Portable mathematics, the component model, the same bits however a run is made."""

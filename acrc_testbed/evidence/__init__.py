"""What the recordings of a run show, as arrays: where everybody was, what was said, heard and done."""

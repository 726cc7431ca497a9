"""The seam to the user's code: what a behaviour may know and do, and how it is found and hosted."""

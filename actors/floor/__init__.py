"""Floor plans: occupancy grids, their sources and computations on them."""

"""Studies: strategies, scenarios, factors and seeds, and the trials that follow from them."""

"""What is to be found out: strategies, scenarios and seeds, and all trials that follow from them."""

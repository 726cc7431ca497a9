"""What the least parts cost: portable mathematics, the component model."""

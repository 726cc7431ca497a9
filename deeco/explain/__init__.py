"""What a component and its ensembles do, told and drawn from their source."""

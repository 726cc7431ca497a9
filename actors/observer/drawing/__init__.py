"""What is drawn of a run with rerun, live and afterwards: entities by their paths, and the layout."""

"""A campaign as an artefact: all that others need to check its results and repeat them."""

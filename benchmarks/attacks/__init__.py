"""Ways past the radio, each tried by a swarm's own members: for `acrc verify attacks` and the tests."""

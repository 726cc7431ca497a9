"""Ways past the radio, each tried by a swarm's own members: for `acrc bench attacks` and the tests."""

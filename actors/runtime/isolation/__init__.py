"""A robot's process shut off from its peers: file tree, system calls, resources."""

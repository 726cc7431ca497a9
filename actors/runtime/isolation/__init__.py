"""A robot's sandbox: file tree, system calls, resources."""

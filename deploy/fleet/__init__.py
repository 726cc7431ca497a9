"""Physical robots: fleet file, keys, system services, on-board processes, and the operator's station."""

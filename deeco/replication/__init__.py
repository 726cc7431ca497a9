"""Knowledge between nodes: how it travels, in which packets and fragments, and which replicas are kept."""

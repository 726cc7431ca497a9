"""The buses that look alike to an actor: Zenoh, memory, replay, and what is laid around them."""

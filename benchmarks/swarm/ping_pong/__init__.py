"""The least that a barrier over Zenoh can cost: one message of 100 bytes to each process, one back."""

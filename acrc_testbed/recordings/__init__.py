"""Contents of recordings, also while a run goes on."""

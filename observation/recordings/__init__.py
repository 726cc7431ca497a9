"""What recordings hold: told, followed while a run goes on, and merged into one file for any reader."""

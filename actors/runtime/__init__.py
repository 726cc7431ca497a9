"""What every actor process shares: the core protocol, the shell, the buses, recording, access, isolation."""

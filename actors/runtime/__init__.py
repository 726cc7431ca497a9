"""Runtime of all actor processes: core interface, shell, buses, recording, access control, isolation."""

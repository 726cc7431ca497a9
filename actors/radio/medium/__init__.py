"""The medium between transceivers, a library without an actor: event loop, CSMA/CA, reception, state."""

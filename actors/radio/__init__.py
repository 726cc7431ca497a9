"""The radio: one process that simulates the medium between the robots' IEEE 802.15.4 transceivers."""

"""The radio: one process that stands for the air between the robots' IEEE 802.15.4 transceivers."""

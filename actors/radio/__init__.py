"""The radio: simulation of the medium between the robots' IEEE 802.15.4 transceivers."""

"""What a robot is made of, on the wire: transceiver, base, range sensors; and emulators of them."""

"""What a change to the testbed itself must pass: checks and test suite."""

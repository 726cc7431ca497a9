"""The robots' serial lines and processes on board, with emulated devices."""

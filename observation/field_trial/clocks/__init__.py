"""The clocks of several robots aligned from radio frames that more than one of them has stamped."""

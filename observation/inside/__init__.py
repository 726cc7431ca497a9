"""What robots perceived and meant, and what became of frames: cores executed again from their recordings."""

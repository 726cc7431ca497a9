"""What one robot perceived, knew and decided: from one replay, kept for all who look."""

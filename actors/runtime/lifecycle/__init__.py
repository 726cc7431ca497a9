"""How processes live and end: who started them, what they leave, what they say of their failure."""

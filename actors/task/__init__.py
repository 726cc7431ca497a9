"""The task of a run: what robots say of it, and how it is judged. Here it is to visit places."""

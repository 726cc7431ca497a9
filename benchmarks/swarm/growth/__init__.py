"""What a robot costs among how many: CPU by part, traffic and memory, from one robot to hundreds."""

"""What is claimed and what is measured: what a person runs to judge the testbed."""

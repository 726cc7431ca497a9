"""The commands of experiments; what each needs is imported once it is called."""

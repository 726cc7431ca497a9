"""Explanations of decisions whose causes were planted."""

"""What is claimed (`acrc verify`) and what is measured (`acrc bench`)."""

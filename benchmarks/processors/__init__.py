"""One run on several processors: `acrc bench processors` builds what it needs and compares the digests."""

"""One run on several processors: `acrc verify processors` builds what it needs and compares the digests."""

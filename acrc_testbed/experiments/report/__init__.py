"""Report on campaigns and single runs: a page with sentences, pictures and tables."""

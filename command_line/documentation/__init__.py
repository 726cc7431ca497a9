"""The pages of docs/ as a site, with a reference made from the code."""

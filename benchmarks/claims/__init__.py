"""What docs/how-true.md claims: one table, which the page is made from and `acrc verify` goes through."""

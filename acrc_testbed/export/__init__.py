"""A run as tables for notebooks and statistics: its columns, its rows, and Parquet files of them."""

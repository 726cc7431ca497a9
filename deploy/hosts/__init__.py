"""Other computers that robots of one run are on: found by Dask, reached by mutual TLS; what stays there."""

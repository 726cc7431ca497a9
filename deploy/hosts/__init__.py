"""Other computers that robots of one run are on: found through Dask, reached by mutual TLS."""

"""Drawing of runs with rerun, into a file and a viewer; used by `acrc_testbed.view`."""

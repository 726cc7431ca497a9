"""Export of runs: Parquet tables and ROS 2 logs."""

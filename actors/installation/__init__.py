"""Where this project is installed, which version of it, and how its command line is called."""

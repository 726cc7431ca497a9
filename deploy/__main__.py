"""`python -m deploy` is the command line."""

from deploy.cli.app import main

main()

"""`python -m lockstep`: the command, where an environment's scripts are not on the path."""

from lockstep.cli.main import main

if __name__ == "__main__":
    main()

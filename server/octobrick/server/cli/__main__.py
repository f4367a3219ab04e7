"""``python -m octobrick.server.cli`` is ``octobrick``."""

from octobrick.server.cli import main

if __name__ == "__main__":
    main(prog_name="octobrick")

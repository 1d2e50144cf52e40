"""`python -m drills` is the command `drills`."""

import os


def main() -> None:
    """Run the console script; a Ctrl-C while its modules load ends it as one later does."""
    try:
        from drills import cli, interrupts

        interrupts.note()
        cli.main()
    except KeyboardInterrupt:
        os.write(2, b"\nStopped.\n")
        os._exit(130)


if __name__ == "__main__":
    main()

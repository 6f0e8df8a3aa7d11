"""``python -m lgmpc``: the same as the command ``lgmpc``."""

from lgmpc.cli import main

if __name__ == "__main__":
    main()

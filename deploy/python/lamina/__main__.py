"""The command line: `watch` is written in Python, all else is the program `lamina`."""

import os
import sys

from .installed import program


def _become(name, arguments):
    path = program(name)
    try:
        os.execvp(path, [name, *arguments])
    except OSError as error:
        sys.exit(f"{path}: {error.strerror}; name its folder in LAMINA_BIN, such as target/release")


def main():
    if sys.argv[1:2] == ["watch"]:
        from .follow import command

        sys.exit(command(sys.argv[2:]))
    _become("lamina", sys.argv[1:])


def generator_node():
    _become("generator-node", sys.argv[1:])


def viz_node():
    _become("viz-node", sys.argv[1:])


def tuner():
    _become("tuner", sys.argv[1:])


if __name__ == "__main__":
    main()

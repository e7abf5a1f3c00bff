"""The command ``inswsn``, which is ``python -m inswsn_book`` as well."""

import os
import sys


def main() -> None:
    """Run ``inswsn``, by an interpreter on which no setting of the reader's Python has a hold.

    That is no module of the working folder or of PYTHONPATH, such as a ``numpy.py``, no warning
    that is made an error, no locale without UTF-8.
    """
    if os.name == "posix" and not sys.flags.isolated:
        again = [sys.executable, "-I", "-X", "utf8", "-m", "inswsn_book"]
        os.execv(sys.executable, [*again, *sys.argv[1:]])
    try:
        from inswsn_book.make.cli import cli, run_command  # noqa: PLC0415
    except KeyboardInterrupt:  # stopped while it was still being loaded
        sys.exit("inswsn: stopped.")
    run_command(cli)


if __name__ == "__main__":
    main()

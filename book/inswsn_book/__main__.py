"""``python -m inswsn_book``: the same command as ``inswsn``."""

import sys

if __name__ == "__main__":
    try:
        from inswsn_book.cli import main
    except KeyboardInterrupt:  # stopped while it was still being loaded
        sys.exit("inswsn: stopped.")
    main()

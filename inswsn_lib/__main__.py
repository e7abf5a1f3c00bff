"""``python -m inswsn_lib``: the same command as ``inswsn``."""

import sys

if __name__ == "__main__":
    try:
        from inswsn_lib.artefact.cli import main
    except KeyboardInterrupt:  # stopped while it was still being loaded
        sys.exit("inswsn: stopped.")
    main()

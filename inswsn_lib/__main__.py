"""``python -m inswsn_lib``: the same command as ``inswsn``."""

from inswsn_lib.artefact.cli import main

main()

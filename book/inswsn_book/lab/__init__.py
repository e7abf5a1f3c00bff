"""JupyterLab for the chapters, in an environment of its own that sees the locked one."""

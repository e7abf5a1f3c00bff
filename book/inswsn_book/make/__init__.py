"""What a command makes: runs with an answer, sweeps, the site, archives, volumes."""

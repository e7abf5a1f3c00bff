"""Claims of the papers, the rule that judges them, and texts that rest on the verdicts."""

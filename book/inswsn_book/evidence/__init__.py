"""What the evidence alone computes with."""

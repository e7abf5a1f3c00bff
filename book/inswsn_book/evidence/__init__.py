"""What the evidence alone computes with."""


def slug(name: str) -> str:
    """Return the name of a method or a case as a part of the name of a quantity."""
    plain = name.lower().replace("%", "percent")
    return plain.replace(",", "").replace(".", "").replace(" ", "-")

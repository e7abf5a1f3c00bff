"""The vehicle of P3: its error model, its filter, and drives, made and recorded."""

from inswsn_lib.vehicle.drive import Drive, Place, Reference

__all__ = ["Drive", "Place", "Reference"]

"""The driven loop: coupling and overlap elimination."""

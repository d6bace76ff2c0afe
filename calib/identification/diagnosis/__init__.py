"""Diagnosis by name: which mistake, change or gap of the model explains what a fit leaves over."""

from calib.identification.diagnosis.held import GROSS, MODEL, Cause, Finding
from calib.identification.diagnosis.naming import diagnose

__all__ = ["GROSS", "MODEL", "Cause", "Finding", "diagnose"]

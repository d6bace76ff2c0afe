"""KUKA KRL programs (``.src`` and ``.dat``): writer, reader and validator."""

from posedesign.programs.kuka_krl.dialect import KukaKrl

__all__ = ["KukaKrl"]

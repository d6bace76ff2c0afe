"""KUKA KRL programs (``.src`` and ``.dat``): writer, reader and validator."""

from posedesign.programs.kuka_krl.spec import KukaKrl

__all__ = ["KukaKrl"]

"""ABB RAPID modules (``.mod``, ``.modx``): writer, reader and validator."""

from posedesign.programs.abb_rapid.spec import AbbRapid

__all__ = ["AbbRapid"]

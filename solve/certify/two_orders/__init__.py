"""Errors by two orders on one grid; see docs/certificate.md."""

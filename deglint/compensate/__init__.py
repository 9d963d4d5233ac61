"""Compensation of glint before removal: one module a stage, arrays only."""

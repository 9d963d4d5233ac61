"""Compensation: what is done to the bands before glint is removed, one stage a module, arrays only."""

"""Formulas of physics and geometry on numbers and tuples. They know neither where a kernel stores
its numbers nor which bodies, joints and loads a scene has."""

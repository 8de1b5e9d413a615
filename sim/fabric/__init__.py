"""Measuring a simulated cloth, and finding the springs that give a fabric."""

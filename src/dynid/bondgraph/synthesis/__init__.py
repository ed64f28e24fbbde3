"""Synthesis of a driving-point impedance as a bond graph: Cauer, Foster and Brune forms."""

"""Tests of a fitted model: residuals, lack of fit, and mistakes of instruments that explain it."""

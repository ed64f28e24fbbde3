"""Where to measure and what to excite: designs ranked by the information they give."""

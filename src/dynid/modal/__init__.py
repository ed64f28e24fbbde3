"""Modal analysis of measured frequency responses: modes with their covariance."""

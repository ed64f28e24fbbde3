"""dynid.cli"""

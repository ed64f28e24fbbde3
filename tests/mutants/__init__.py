"""Mutation testing: is every line of what matters most held by a test that fails when it is wrong?"""

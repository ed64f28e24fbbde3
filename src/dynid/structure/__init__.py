"""dynid.structure"""

"""dynid.bondgraph"""

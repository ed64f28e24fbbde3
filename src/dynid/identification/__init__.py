"""dynid.identification"""

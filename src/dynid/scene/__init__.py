"""dynid.scene"""

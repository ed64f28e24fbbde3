"""dynid.lti"""

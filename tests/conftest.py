"""What all tests stand on."""

import signal

# Who starts the tests in the background of a script lets them ignore Ctrl-C, and with them every command
# that they start; some tests are about just that signal.
signal.signal(signal.SIGINT, signal.default_int_handler)

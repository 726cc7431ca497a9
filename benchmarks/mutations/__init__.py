"""What every parser of bytes from outside makes of damaged ones: a sentence, never a traceback."""

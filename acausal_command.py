"""The command `acausal`, outside of the package: importing the package takes long enough for Ctrl-C to be pressed."""

from __future__ import annotations

import os
import signal
import sys


def run() -> None:
    """Run the command line; whatever ends it while it begins ends without a traceback."""
    try:
        from acausal.cli.main import app

        app(prog_name="acausal")
    except KeyboardInterrupt:
        _end("error[AC490]: interrupted", 130)
    except BrokenPipeError:
        _end("", 1)
    except OSError as error:
        _end(f"error[AC012]: cannot write: {error.strerror or error}", 2)
    finally:
        # Everything is done and said: Ctrl-C while Python ends would make of it a death by a signal.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _end(text: str, code: int) -> None:
    if text:
        sys.stderr.write(text + "\n")
        sys.stderr.flush()
    # At once: what is left in the buffer of a full or closed output has no place, and imports may be half done.
    os._exit(code)


if __name__ == "__main__":
    run()
